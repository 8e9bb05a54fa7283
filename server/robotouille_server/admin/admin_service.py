"""What the operator sees of a server and may do to it, on the server's loop."""

from __future__ import annotations

import asyncio
import copy
from collections import Counter
from collections.abc import Callable, Iterable
from http import HTTPStatus

from robotouille.episode import Phase
from robotouille.errors import ProtocolError, RecordingError
from robotouille.release import VERSION
from robotouille.replay.container import unwrap
from robotouille_server.admin.admin_rows import (
    PHASES,
    RowBuilder,
    phase_of,
    recording_name,
    shown_code,
)
from robotouille_server.admin.errors import RequestRefusedError
from robotouille_server.admin.models import (
    AlertRow,
    Done,
    EpisodeCounts,
    EpisodeDetail,
    Overview,
    RecordingFault,
    RecordingPage,
    ServerInfo,
    Totals,
)
from robotouille_server.admin.principal import Principal
from robotouille_server.admin.rates import History, by_label, gauge
from robotouille_server.admin.recording_store import NoRecordings, Readable, RecordingStore
from robotouille_server.admin.transcript import News, Transcript
from robotouille_server.app import Server
from robotouille_server.rooms.recordings import CLOSED
from robotouille_server.rooms.room import Room
from robotouille_server.rooms.session import Session
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.workers import ElsewhereError

__all__ = ["AdminService", "Watch"]

MAX_UNRESTORED = 20
READ_BYTES_A_SECOND = 8_000_000
"""So fast is a growing recording read again and again for somebody who watches."""


class AdminService:
    """One server's operator. `now` is the loop's time.

    What somebody may see and do is that of `serving` them; a principal whose token is for one
    episode is at a server that has no other.
    """

    def __init__(self, server: Server, now: Callable[[], float]) -> None:
        self._server = server
        self._now = now
        self._opened = now()
        self._rows = RowBuilder(server)
        self._history = History(server.metrics)
        self._storage: Readable = server.storage or NoRecordings()
        self._store = RecordingStore(self._storage)
        self._history.sample(self._opened)
        self._principal = Principal()
        server.sample(self._opened)

    def serving(self, principal: Principal) -> AdminService:
        """The same service, for this principal."""
        service = copy.copy(self)
        service._principal = principal
        return service

    def tick(self) -> None:
        """To be called about once a second."""
        now = self._now()
        self._history.sample(now)
        self._rows.forget(now)
        self._server.sample(now)

    # Seeing

    def overview(
        self, phase: str = "", search: str = "", limit: int = 50, offset: int = 0
    ) -> Overview:
        """Totals, and the episodes that match: in this phase, with all these words."""
        words = search.lower().split()
        census = [(room, phase_of(room)) for room in self._rooms()]
        found = [
            (room, its)
            for room, its in census
            if phase in ("", its) and (not words or _matches(room, words))
        ]
        found.sort(key=_rank)
        now = self._now()
        return Overview(
            server=ServerInfo(
                version=VERSION,
                url=self._server.public_url,
                uptime=round(now - self._opened, 1),
                only=self._principal.only,
            ),
            totals=self._totals(Counter(its for _, its in census)),
            alerts=self._alerts(),
            faults=self._faults(room for room, _ in census),
            found=len(found),
            episodes=[self._rows.row(room, now) for room, _ in found[offset : offset + limit]],
        )

    def room(self, name: str) -> Room:
        """The room of an id or a code; RequestRefusedError if there is none, or the principal may
        not see it: who looks for others is not told which there are."""
        try:
            room = self._server.lobby.find(name)
            self._principal.check(room.id, room.code)
            return room
        except ProtocolError as error:
            self._principal.check(name)
            raise RequestRefusedError(
                HTTPStatus.NOT_FOUND, "episode/unknown", error.message
            ) from None
        except ElsewhereError as error:
            self._principal.check(name)
            message = f"{name} is with another worker; look at the operator's view of that one"
            raise RequestRefusedError(HTTPStatus.NOT_FOUND, "episode/unknown", message) from error

    async def recordings(self, search: str, limit: int, offset: int) -> RecordingPage:
        """The list of recordings, the newest first."""
        live = {
            recording_name(room): room.id
            for room in self._rooms()
            if room.episode.phase is not Phase.ENDED
        }
        if self._principal.only:
            search = f"{search} {self._only_file()}"
        return await asyncio.to_thread(self._store.page, search, limit, offset, live)

    async def recording(self, name: str) -> bytes:
        """A recording to download, up to its last whole frame."""
        if self._principal.only and not name.removesuffix(".part").endswith(self._only_file()):
            self._principal.check()
        content = await asyncio.to_thread(self._store.content, name)
        self._note("recording", file=name)
        return content

    def _only_file(self) -> str:
        """How the name of the only recording ends that the principal may see. A recording has its
        episode's id in its name: that of a code is known as long as the episode is there."""
        ids = (room.id for room in self._rooms())
        return f"_{next(ids, self._principal.only.lower())}{CLOSED}"

    def _rooms(self) -> list[Room]:
        """The newest first."""
        rooms = list(self._server.lobby.rooms.values())[::-1]
        if not self._principal.only:
            return rooms
        return [room for room in rooms if self._principal.may_see(room.id, room.code)]

    def _alerts(self) -> list[AlertRow]:
        """What the whole server's operator must look after."""
        if self._principal.only:
            return []
        found = self._server.alerts()
        return [AlertRow(kind=a.kind, text=a.text, severity=a.severity) for a in found]

    def _totals(self, phases: Counter[str]) -> Totals:
        history, metrics = self._history, self._server.metrics
        return Totals(
            connections=gauge(metrics.connections),
            episodes=EpisodeCounts(**{name: phases[name] for name in PHASES}),
            steps_per_second=history.rate(lambda s: s.steps),
            sent_bytes_per_second=history.rate(lambda s: s.sent_bytes),
            received_per_second=history.rate(lambda s: s.received),
            lateness=history.lateness(),
            history={
                "steps": history.seconds(lambda s: s.steps),
                "bytes": history.seconds(lambda s: s.sent_bytes),
                "received": history.seconds(lambda s: s.received),
            },
            errors=by_label(metrics.errors),
            dropped=by_label(metrics.dropped),
        )

    def _faults(self, rooms: Iterable[Room]) -> list[RecordingFault]:
        """Each problem once, with the first episode that has it."""
        troubled: dict[str, list[Room]] = {}
        for room in rooms:
            if problem := room.problem:
                troubled.setdefault(problem, []).append(room)
        faults = [
            RecordingFault(
                text=text, episodes=len(those), episode=those[0].id, code=shown_code(those[0].code)
            )
            for text, those in troubled.items()
        ]
        ours = self._only_file() if self._principal.only else ""
        unrestored = [one for one in self._server.lobby.unrestored.items() if ours in one[0]]
        return faults + [
            RecordingFault(
                text=f"{name} was not restored: {reason}", episodes=0, episode="", code=""
            )
            for name, reason in unrestored[:MAX_UNRESTORED]
        ]

    # Doing

    def pause(self, name: str) -> Done:
        """Let an episode's time stand still until `resume`."""
        room = self._live(name)
        room.pause()
        return self._done("pause", room, f"{shown_code(room.code)} stands still")

    def resume(self, name: str) -> Done:
        """Undo `pause`."""
        room = self._live(name)
        room.resume()
        return self._done("resume", room, f"{shown_code(room.code)} goes on")

    def end(self, name: str, reason: str) -> Done:
        """End an episode now."""
        room = self._live(name)
        room.abort(reason or "ended by the operator")
        return self._done("end", room, f"{shown_code(room.code)} is over", reason=reason)

    def kick(self, name: str, session: str, reason: str) -> Done:
        """Remove a player or a spectator from an episode."""
        room = self.room(name)
        who = _member(room, session)
        called = who.name
        room.kick(who, reason or "removed by the operator")
        return self._done("kick", room, f"{called} was removed", session=session, reason=reason)

    def mute(self, name: str, session: str, *, muted: bool) -> Done:
        """Let a player or a spectator talk no more, or again."""
        room = self._live(name)
        who = _member(room, session)
        if muted:
            room.mute(who)
        else:
            room.unmute(who)
        done = f"{who.name} may {'not ' if muted else ''}talk{'' if muted else ' again'}"
        return self._done("mute" if muted else "unmute", room, done, session=session)

    def announce(self, name: str, text: str) -> Done:
        """Say something to everybody in an episode."""
        room = self._live(name)
        room.announce(text)
        return self._done("announce", room, f"told everybody in {shown_code(room.code)}", text=text)

    def announce_to_all(self, text: str) -> Done:
        """Say something to everybody in all episodes."""
        self._principal.check()
        self._server.announce(text)
        get_logger().info("operator: announce to all", text=text)
        self._note("announce to all", text=text)
        return Done(done="told everybody")

    def _live(self, name: str) -> Room:
        room = self.room(name)
        if room.episode.phase is Phase.ENDED:
            message = f"{shown_code(room.code)} is over"
            raise RequestRefusedError(HTTPStatus.CONFLICT, "episode/over", message)
        return room

    def _done(self, what: str, room: Room, done: str, **details: str) -> Done:
        get_logger().info(f"operator: {what}", episode=room.id, code=room.code, **details)
        self._note(what, room.id, **details)
        return Done(done=done)

    def refused(self, what: str, episode: str, code: str) -> None:
        """The principal asked for something that was not done."""
        self._note(what, episode, result=code)

    def _note(self, what: str, episode: str = "", result: str = "done", **details: str) -> None:
        principal = self._principal
        self._server.audit.note(
            what,
            by=principal.name,
            token=principal.token_id,
            episode=episode,
            result=result,
            details=details,
        )

    def watch(self, name: str) -> Watch:
        """Follow one episode."""
        return Watch(self.room(name), self._storage, self._rows, self._now)


class Watch:
    """One episode as it goes on: its state, and what its recording says happened."""

    def __init__(
        self, room: Room, storage: Readable, rows: RowBuilder, now: Callable[[], float]
    ) -> None:
        self._room = room
        self._storage = storage
        self._rows = rows
        self._now = now
        self._transcript = Transcript(self._sentence)
        self._read = ("", 0)
        self._rested = 0.0

    async def look(self) -> EpisodeDetail:
        """How it stands now."""
        await self._catch_up()
        return self._rows.detail(self._room, self._now(), self._transcript.lines)

    async def _catch_up(self) -> None:
        """Read what is new in the recording. Where it cannot be read, the room's problem says
        so and the lines stay as they are."""
        room = self._room
        name, size = recording_name(room), room.journal.size if room.journal is not None else 0
        if not name or (name, size) == self._read or self._now() < self._rested:
            return
        try:
            news, length = await asyncio.to_thread(self._news, name)
        except (OSError, RecordingError) as error:
            get_logger().debug("recording not read", file=name, error=str(error))
            return
        self._transcript.take(news)
        self._read = name, size
        self._rested = self._now() + length / READ_BYTES_A_SECOND

    def _news(self, name: str) -> tuple[News, int]:
        """What is new in a file, and how long the file is; in a thread."""
        content = self._storage.read(name)
        return self._transcript.news(unwrap(content)), len(content)

    def _sentence(self, row: list[str]) -> str:
        return self._room.world.action(*row).sentence


def _rank(found: tuple[Room, str]) -> tuple[bool, int]:
    """The order of the list: trouble first, then what stands still, what is over last."""
    room, phase = found
    return not room.problem, PHASES.index(phase)


def _matches(room: Room, words: list[str]) -> bool:
    """Whether a room's code, task, id, names or labels contain all words."""
    names = [seat.name for seat in room.episode.seats.values()]
    labels = [f"{name}={value}" for name, value in room.labels.items()]
    text = " ".join(
        [room.code, shown_code(room.code), room.world.task.name, room.id, *names, *labels]
    )
    return all(word in text.lower() for word in words)


def _member(room: Room, session_id: str) -> Session:
    for session in room.members:
        if session.id == session_id:
            return session
    message = f"nobody with the session {session_id!r} is in {shown_code(room.code)}"
    raise RequestRefusedError(HTTPStatus.NOT_FOUND, "session/unknown", message)
