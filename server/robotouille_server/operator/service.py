"""Views and actions of operators, for the HTTP API and for MQTT commands."""

from __future__ import annotations

import asyncio
import copy
from collections import Counter
from collections.abc import Callable, Iterable
from http import HTTPStatus

from robotouille.episode import Phase
from robotouille.errors import ProtocolError, RecordingError
from robotouille.installation import VERSION
from robotouille.replay.container import unwrap
from robotouille.replay.file_names import CLOSED
from robotouille_server.app import Server
from robotouille_server.operator.models import (
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
from robotouille_server.operator.principal import Principal, RequestRefusedError
from robotouille_server.operator.recordings import (
    NewFrames,
    NoRecordings,
    ReadableStorage,
    RecordingStore,
    Transcript,
)
from robotouille_server.operator.rows import (
    PHASES,
    MetricsHistory,
    RoomRows,
    by_label,
    gauge,
    phase_of,
    recording_name,
    shown_code,
)
from robotouille_server.rooms.room import Room
from robotouille_server.rooms.session import Session
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.workers import ElsewhereError

MAX_UNRESTORED = 20
READ_BYTES_A_SECOND = 8_000_000
"""Limit for reading a growing recording again, so that watching a long one stays cheap."""


class OperatorService:
    """Operations on one server, as a principal may use them.

    A token can be limited to one episode. Its principal then sees a server without any other
    episode. `now` returns the loop's time. All methods run on the server's event loop.
    """

    def __init__(self, server: Server, now: Callable[[], float]) -> None:
        self._server = server
        self._now = now
        self._opened = now()
        self._rows = RoomRows(server)
        self._history = MetricsHistory(server.metrics)
        self._storage: ReadableStorage = server.storage or NoRecordings()
        self._store = RecordingStore(self._storage)
        self._history.sample(self._opened)
        self._principal = Principal()
        server.sample(self._opened)

    def for_principal(self, principal: Principal) -> OperatorService:
        """Return this service for another principal."""
        # A copy shares the histories and caches, so one service per request is cheap.
        service = copy.copy(self)
        service._principal = principal
        return service

    def tick(self) -> None:
        """Take a sample of the server's figures. Call this about once per second."""
        now = self._now()
        self._history.sample(now)
        self._rows.forget(now)
        self._server.sample(now)

    def overview(
        self, phase: str = "", search: str = "", limit: int = 50, offset: int = 0
    ) -> Overview:
        """Return totals and the episodes that are in a phase and contain all words of a search."""
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
                draining=self._server.lobby.draining,
                only=self._principal.only_episode,
            ),
            totals=self._totals(Counter(its for _, its in census)),
            alerts=self._alerts(),
            faults=self._faults(room for room, _ in census),
            found=len(found),
            episodes=[self._rows.row(room, now) for room, _ in found[offset : offset + limit]],
        )

    def room(self, name: str) -> Room:
        """Return the room with an id or a code.

        Raises:
            RequestRefusedError: There is no such room, or the principal may not see it. A
                principal of one episode gets the same error for both, so that it cannot find out
                which other episodes exist.
        """
        try:
            room = self._server.lobby.find(name)
            self._principal.require_episode(room.id, room.code)
            return room
        except ProtocolError as error:
            self._principal.require_episode(name)
            raise RequestRefusedError(
                HTTPStatus.NOT_FOUND, "episode/unknown", error.message
            ) from None
        except ElsewhereError as error:
            self._principal.require_episode(name)
            message = f"{name} runs on another worker; use the operator page of that worker"
            raise RequestRefusedError(HTTPStatus.NOT_FOUND, "episode/unknown", message) from error

    async def recordings(self, search: str, limit: int, offset: int) -> RecordingPage:
        """Return a page of the list of recordings, newest first."""
        live = {
            recording_name(room): room.id
            for room in self._rooms()
            if room.episode.phase is not Phase.ENDED
        }
        if self._principal.only_episode:
            search = f"{search} {self._only_file()}"
        return await asyncio.to_thread(self._store.page, search, limit, offset, live)

    async def recording(self, name: str) -> bytes:
        """Return the content of a recording, up to its last complete frame."""
        closed_name = name.removesuffix(".part")
        if self._principal.only_episode and not closed_name.endswith(self._only_file()):
            self._principal.require_episode()
        content = await asyncio.to_thread(self._store.content, name)
        self._note("recording", file=name)
        return content

    def _only_file(self) -> str:
        """Return the end of the name of the only recording that the principal may see.

        Recordings are named after the episode's id. If the token has a code instead, the id is
        known only while the episode is on the server.
        """
        ids = (room.id for room in self._rooms())
        return f"_{next(ids, self._principal.only_episode.lower())}{CLOSED}"

    def _rooms(self) -> list[Room]:
        """Return the rooms that the principal may see, newest first."""
        rooms = list(self._server.lobby.rooms.values())[::-1]
        if not self._principal.only_episode:
            return rooms
        return [room for room in rooms if self._principal.may_see(room.id, room.code)]

    def _alerts(self) -> list[AlertRow]:
        if self._principal.only_episode:
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
        """Return each problem once, with the first episode that has it."""
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
        ours = self._only_file() if self._principal.only_episode else ""
        unrestored = [one for one in self._server.lobby.unrestored.items() if ours in one[0]]
        return faults + [
            RecordingFault(
                text=f"{name} was not restored: {reason}", episodes=0, episode="", code=""
            )
            for name, reason in unrestored[:MAX_UNRESTORED]
        ]

    def pause(self, name: str) -> Done:
        """Pause an episode until `resume`."""
        room = self._live(name)
        room.pause()
        return self._done("pause", room, f"{shown_code(room.code)} is paused")

    def resume(self, name: str) -> Done:
        """End the operator's pause of an episode."""
        room = self._live(name)
        room.resume()
        return self._done("resume", room, f"{shown_code(room.code)} is resumed")

    def end(self, name: str, reason: str) -> Done:
        """End an episode now."""
        room = self._live(name)
        room.abort(reason or "ended by the operator")
        return self._done("end", room, f"{shown_code(room.code)} has ended", reason=reason)

    def kick(self, name: str, session: str, reason: str) -> Done:
        """Remove a player or a spectator from an episode."""
        room = self.room(name)
        who = _member(room, session)
        called = who.name
        room.kick(who, reason or "removed by the operator")
        return self._done("kick", room, f"{called} was removed", session=session, reason=reason)

    def mute(self, name: str, session: str, *, muted: bool) -> Done:
        """Forbid a player or a spectator to chat, or allow it again."""
        room = self._live(name)
        who = _member(room, session)
        if muted:
            room.mute(who)
        else:
            room.unmute(who)
        done = f"{who.name} {'is muted' if muted else 'may chat again'}"
        return self._done("mute" if muted else "unmute", room, done, session=session)

    def announce(self, name: str, text: str) -> Done:
        """Send an announcement to everyone in an episode."""
        room = self._live(name)
        room.announce(text)
        done = f"announcement sent to {shown_code(room.code)}"
        return self._done("announce", room, done, text=text)

    def announce_to_all(self, text: str) -> Done:
        """Send an announcement to everyone in all episodes."""
        self._principal.require_episode()
        self._server.announce(text)
        get_logger().info("operator: announce to all", text=text)
        self._note("announce to all", text=text)
        return Done(done="announcement sent to all episodes")

    def _live(self, name: str) -> Room:
        room = self.room(name)
        if room.episode.phase is Phase.ENDED:
            message = f"{shown_code(room.code)} has ended"
            raise RequestRefusedError(HTTPStatus.CONFLICT, "episode/ended", message)
        return room

    def _done(self, what: str, room: Room, done: str, **details: str) -> Done:
        get_logger().info(f"operator: {what}", episode=room.id, code=room.code, **details)
        self._note(what, room.id, **details)
        return Done(done=done)

    def refused(self, what: str, episode: str, code: str) -> None:
        """Note a refused request of the principal in the audit log."""
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

    def watch(self, name: str) -> EpisodeWatch:
        """Return a view of one episode that can be read repeatedly."""
        return EpisodeWatch(self.room(name), self._storage, self._rows, self._now)


class EpisodeWatch:
    """Live view of one episode: its state, and recent events from its recording."""

    def __init__(
        self, room: Room, storage: ReadableStorage, rows: RoomRows, now: Callable[[], float]
    ) -> None:
        self._room = room
        self._storage = storage
        self._rows = rows
        self._now = now
        self._transcript = Transcript(self._sentence)
        self._read = ("", 0)
        self._next_read = 0.0

    async def detail(self) -> EpisodeDetail:
        """Return the episode as it is now."""
        await self._catch_up()
        return self._rows.detail(self._room, self._now(), self._transcript.lines)

    async def _catch_up(self) -> None:
        """Read new frames of the recording.

        If the recording cannot be read, the lines stay as they are. The room reports the problem.
        """
        room = self._room
        name, size = recording_name(room), room.journal.size if room.journal is not None else 0
        if not name or (name, size) == self._read or self._now() < self._next_read:
            return
        try:
            # Reading a long file would delay the steps of all episodes.
            new, length = await asyncio.to_thread(self._new_frames, name)
        except (OSError, RecordingError) as error:
            get_logger().debug("recording not read", file=name, error=str(error))
            return
        self._transcript.add(new)
        self._read = name, size
        # Each read loads the whole file, so a long recording is read less often.
        self._next_read = self._now() + length / READ_BYTES_A_SECOND

    def _new_frames(self, name: str) -> tuple[NewFrames, int]:
        """Return the new frames of a file, and the file's length."""
        content = self._storage.read(name)
        return self._transcript.new_frames(unwrap(content)), len(content)

    def _sentence(self, row: list[str]) -> str:
        return self._room.world.action(*row).sentence


def _rank(found: tuple[Room, str]) -> tuple[bool, int]:
    """Sort episodes with problems first, then paused ones; ended ones come last."""
    room, phase = found
    return not room.problem, PHASES.index(phase)


def _matches(room: Room, words: list[str]) -> bool:
    """Return whether a room's code, task, id, names or labels contain all words."""
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
    message = f"no session {session_id!r} in {shown_code(room.code)}"
    raise RequestRefusedError(HTTPStatus.NOT_FOUND, "session/unknown", message)
