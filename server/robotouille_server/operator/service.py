"""Views and actions of operators, for the HTTP API and for MQTT commands."""

from __future__ import annotations

import copy
import secrets
from base64 import b64encode
from collections import Counter
from collections.abc import Awaitable, Callable, Iterable
from functools import partial
from http import HTTPStatus
from operator import itemgetter

from robotouille.episode import Phase
from robotouille.errors import ProtocolError
from robotouille.installation import VERSION
from robotouille.planning.policies.skill import SKILLS
from robotouille_server.app import Server
from robotouille_server.operator.load import ROOMS_A_TURN, ROWS_A_TURN, HeavyJobs, Turns
from robotouille_server.operator.merging import PHASES, rank
from robotouille_server.operator.models import (
    RANKS,
    AlertRow,
    Done,
    EpisodeCounts,
    EpisodeDetail,
    EpisodeRow,
    KitchenTables,
    NodeOverview,
    OpenedEpisode,
    OpenedEpisodes,
    OpenRequest,
    Overview,
    PictureData,
    Problem,
    RecordingFault,
    ServerInfo,
    SpectatorLink,
    TaskList,
    Totals,
)
from robotouille_server.operator.opening import open_episodes, refused_opening, task_rows
from robotouille_server.operator.other_nodes import (
    EpisodeElsewhereError,
    OtherNodes,
    OverviewQuery,
    cluster_node,
)
from robotouille_server.operator.principal import Principal, RequestRefusedError, note
from robotouille_server.operator.recordings import StoredRecordings
from robotouille_server.operator.recordings.room_transcripts import RoomTranscript, RoomTranscripts
from robotouille_server.operator.recordings.store import (
    NoRecordings,
    ReadableStorage,
)
from robotouille_server.operator.rows import (
    MetricsHistory,
    RoomRows,
    by_label,
    gauge,
    kitchen_tables,
    phase_of,
    rooms_of,
    search_text,
    shown_code,
)
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.workers import ElsewhereError

MAX_NOTED_NAME = 64
"""Characters of the episode's name in the audit log's line about a refused request."""
MAX_UNRESTORED = 20
WATCH_SECONDS = 0.25
"""Seconds between two looks at a watched episode."""
OTHER_NODE_SECONDS = 1.0
"""The same for an episode of another node."""
SPECTATOR_LINK_SECONDS = 86_400.0
"""Validity of a link for a spectator."""
RETRY_SECONDS = 1
"""Seconds after which a request for an episode that moves to another node may succeed."""


class OperatorService:
    """Operations on one server, limited to what a principal may see and do.

    A token can be limited to one episode. The principal then sees no other episode. `now` returns
    the loop's time. All methods run on the server's event loop.
    """

    def __init__(self, server: Server, now: Callable[[], float]) -> None:
        self._server = server
        self._now = now
        self._opened = now()
        node = cluster_node(server)
        self.others = OtherNodes(node) if node is not None else None
        self.turns = Turns(server.admission.loop_budget, now)
        self._rows = RoomRows(server, self._node)
        self._history = MetricsHistory(server.metrics)
        storage: ReadableStorage = server.storage or NoRecordings()
        self._jobs = HeavyJobs()
        self.recordings = StoredRecordings(server, storage, self._jobs, self.turns, self.others)
        self._transcripts = RoomTranscripts(storage, self._jobs)
        self._history.sample(self._opened)
        self._principal = Principal()
        server.sample(self._opened)

    def for_principal(self, principal: Principal) -> OperatorService:
        """Return this service for another principal."""
        # A copy shares the histories and caches, so one service per request is cheap.
        service = copy.copy(self)
        service._principal = principal
        service.recordings = self.recordings.for_principal(principal)
        return service

    def tick(self) -> None:
        """Take a sample of the server's figures. Call this about once per second."""
        now = self._now()
        self._history.sample(now)
        self._rows.forget(now)
        self._transcripts.forget(self._server.lobby.rooms)
        self._server.sample(now)

    async def overview(self, query: OverviewQuery) -> Overview:
        """Return totals and the episodes that are in a phase and contain all words of a search."""
        if self.others is not None:
            return await self.others.overview(self.part, self._principal, query)
        return Overview(**dict(await self.part(query)))

    async def part(self, query: OverviewQuery) -> NodeOverview:
        """Return this server's part of the overview."""
        rooms = rooms_of(self._server.lobby, self._principal)
        phases: Counter[str] = Counter()
        found: list[tuple[int, Room]] = []
        async for some in self.turns.parts(rooms, ROOMS_A_TURN):
            census = [(room, phase_of(room)) for room in some]
            phases.update(its for _, its in census)
            found += _found(census, query)
        found.sort(key=itemgetter(0))
        ranks = Counter(map(itemgetter(0), found))
        shown = found[query.offset : query.offset + query.limit]
        rows: list[EpisodeRow] = []
        async for page in self.turns.parts(shown, ROWS_A_TURN):
            now = self._now()
            rows += [self._rows.row(room, now) for _, room in page]
        return NodeOverview(
            server=ServerInfo(
                version=VERSION,
                url=self._server.public_url,
                uptime=round(self._now() - self._opened, 1),
                draining=self._server.lobby.draining,
                only=self._principal.only_episode,
                page=self._server.listener.page_url,
            ),
            totals=self._totals(phases),
            alerts=self._alerts(),
            faults=self._faults(rooms),
            found=len(found),
            episodes=rows,
            ranks=[ranks[number] for number in range(RANKS)],
        )

    def _node(self) -> str:
        """Return the address of this node; empty without a cluster."""
        return self.others.own.url if self.others is not None else ""

    def room(self, name: str) -> Room:
        """Return the room with an id or a code.

        Raises:
            EpisodeElsewhereError: Another node of the cluster has the episode.
            RequestRefusedError: There is no such room, or the principal may not see it. A
                principal of one episode gets the same error for both, so that it cannot find out
                which other episodes exist.
        """
        try:
            room = self._server.lobby.find(name)
            self._principal.require_episode(room.id, room.code)
            return room
        except ProtocolError as error:
            self._require(name)
            if self.others is not None and error.code == "server/handover":
                raise _moving(error.message) from None
            raise RequestRefusedError(
                HTTPStatus.NOT_FOUND, "episode/unknown", error.message
            ) from None
        except ElsewhereError as error:
            self._require(name)
            if self.others is not None:
                raise self._elsewhere(name) from None
            message = f"{name} runs on another worker; use the operator page of that worker"
            raise RequestRefusedError(HTTPStatus.NOT_FOUND, "episode/unknown", message) from error

    def _require(self, name: str) -> None:
        """Refuse an episode of another process that the principal may not see."""
        names = (name,) if self.others is None else self.others.names(name)
        self._principal.require_episode(*names)

    def _elsewhere(self, name: str) -> RequestRefusedError:
        node = self.others.place(name) if self.others is not None else None
        # A request that was forwarded here is not forwarded again.
        if node is None or self._principal.via:
            return _moving("this episode is moving to another node; try again in a moment")
        return EpisodeElsewhereError(node, name)

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
        ours = self.recordings.only_file() if self._principal.only_episode else ""
        unrestored = [one for one in self._server.lobby.unrestored.items() if ours in one[0]]
        return faults + [
            RecordingFault(
                text=f"{name} was not restored: {reason}", episodes=0, episode="", code=""
            )
            for name, reason in unrestored[:MAX_UNRESTORED]
        ]

    async def tasks(self) -> TaskList:
        """Return the tasks of episodes that the principal may open."""
        self._principal.require_episode()
        rows = await self._jobs.run(task_rows, self._server.lobby.tasks)
        return TaskList(tasks=rows, skills=list(SKILLS))

    async def open(self, request: OpenRequest) -> OpenedEpisodes:
        """Open episodes, which belong to the subject of the principal's token."""
        self._principal.require_episode()
        owner = self._principal.token_subject or ""
        opened: list[OpenedEpisode] = []
        problem = None
        try:
            async for one in open_episodes(self._server.services, self.turns, request, owner):
                self._note("open episodes", one.episode)
                opened.append(one)
        except ProtocolError as error:
            if not opened:
                raise refused_opening(error) from None
            problem = Problem(code=error.code, message=error.message, field=error.field)
        get_logger().info("operator: open episodes", count=len(opened))
        return OpenedEpisodes(opened=opened, problem=problem)

    def kitchen(self, name: str) -> KitchenTables:
        """Return everything for drawing an episode, besides its changing state."""
        room = self.room(name)
        return kitchen_tables(room, self._server.lobby.tasks.assets(room.task))

    def picture(self, name: str, digest: str) -> PictureData:
        """Return a picture of an episode's task."""
        tasks = self._server.lobby.tasks
        assets = tasks.assets(self.room(name).task)
        if assets is None or digest not in assets.pictures.values():
            message = "this episode has no such picture"
            raise RequestRefusedError(HTTPStatus.NOT_FOUND, "request/unknown", message)
        return PictureData(data=b64encode(tasks.picture(digest)).decode())

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

    def spectator_link(self, name: str) -> SpectatorLink:
        """Return a new link with which one person watches an episode in a browser."""
        room = self._live(name)
        # A removed spectator is banned by subject, so each link has a subject of its own.
        subject = f"spectator-{secrets.token_hex(4)}"
        link = self._server.tokens.mint_link(
            subject, seconds=SPECTATOR_LINK_SECONDS, code=room.code, watch=True
        )
        self._note("spectator link", room.id, subject=subject)
        return SpectatorLink(link=link)

    async def announce_to_all(self, text: str) -> Done:
        """Send an announcement to everyone in all episodes, on all nodes of a cluster."""
        self._principal.require_episode()
        self._server.announce(text)
        get_logger().info("operator: announce to all", text=text)
        self._note("announce to all", text=text)
        done = "announcement sent to all episodes"
        if self.others is not None and not self._principal.via:
            failed = await self.others.announce(self._principal, text)
            done += f", but not on {', '.join(failed)}" if failed else ""
        return Done(done=done)

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
        self._note(what, episode[:MAX_NOTED_NAME], result=code)

    def _note(self, what: str, episode: str = "", result: str = "done", **details: str) -> None:
        note(self._server.audit, self._principal, what, episode, result, **details)

    def watch(self, name: str) -> EpisodeWatch:
        """Return a view of one episode that can be read repeatedly."""
        room = self.room(name)
        return EpisodeWatch(room, self._transcripts.of(room), self._rows, self.turns, self._now)

    def watch_anywhere(self, name: str) -> tuple[Callable[[], Awaitable[EpisodeDetail]], float]:
        """Return a function that reads an episode of any node, and the seconds between reads."""
        try:
            watch = self.watch(name)
        except EpisodeElsewhereError:
            return partial(self._detail_anywhere, name), OTHER_NODE_SECONDS
        # In a cluster, the episode may move to another node between two reads.
        read = watch.detail if self.others is None else partial(self._detail_anywhere, name)
        return read, WATCH_SECONDS

    async def _detail_anywhere(self, name: str) -> EpisodeDetail:
        try:
            return await self.watch(name).detail()
        except EpisodeElsewhereError as elsewhere:
            if self.others is None:
                raise
            return await self.others.detail(elsewhere.node, self._principal, name)


class EpisodeWatch:
    """Live view of one episode: its state, and recent events from its recording."""

    def __init__(
        self,
        room: Room,
        transcript: RoomTranscript,
        rows: RoomRows,
        turns: Turns,
        now: Callable[[], float],
    ) -> None:
        self._room = room
        self._transcript = transcript
        self._rows = rows
        self._turns = turns
        self._now = now

    async def detail(self) -> EpisodeDetail:
        """Return the episode as it is now."""
        await self._transcript.catch_up()
        await self._turns.next()
        return self._rows.detail(self._room, self._now(), self._transcript.lines)


def _moving(message: str) -> RequestRefusedError:
    return RequestRefusedError(
        HTTPStatus.SERVICE_UNAVAILABLE, "episode/handover", message, RETRY_SECONDS
    )


def _found(census: Iterable[tuple[Room, str]], query: OverviewQuery) -> list[tuple[int, Room]]:
    """Return the rooms that an overview contains, each with its rank."""
    words = query.search.lower().split()
    return [
        (rank(phase, room.problem), room)
        for room, phase in census
        if query.phase in ("", phase) and (not words or _matches(room, words))
    ]


def _matches(room: Room, words: list[str]) -> bool:
    """Return whether a room's code, task, id, names or labels contain all words."""
    names = [seat.name for seat in room.episode.seats.values()]
    text = search_text(room.code, room.world.task.name, [room.id, *names], room.labels)
    return all(word in text for word in words)


def _member(room: Room, session_id: str) -> Session:
    for session in (*room.members, *room.guests.values()):
        if session.id == session_id:
            return session
    message = f"no session {session_id!r} in {shown_code(room.code)}"
    raise RequestRefusedError(HTTPStatus.NOT_FOUND, "session/unknown", message)
