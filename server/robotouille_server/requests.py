"""Requests of participants after `hello`, and their answers."""

from __future__ import annotations

import asyncio
import hashlib
from base64 import b64encode
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Mapping
from contextlib import (
    AbstractAsyncContextManager,
    AbstractContextManager,
    contextmanager,
    nullcontext,
)
from dataclasses import dataclass, field
from typing import Any, Protocol

from pydantic import BaseModel

from robotouille.certification.step_limit import retimed_length
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode
from robotouille_server.auth import (
    CodeGuessLimiter,
    ConnectionLimiter,
    Role,
    Tokens,
    UsedTokens,
    Visitor,
    check_join,
    check_opening,
    check_permission,
)
from robotouille_server.rooms.lobby import Lobby
from robotouille_server.rooms.participants.session import JoinedRoom, Session, SessionLimits
from robotouille_server.rooms.participants.sessions import Sessions
from robotouille_server.rooms.rematches import Asker
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.budgets import STEP_COST
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.task_folder import TaskAssets
from robotouille_server.runtime.workers import ElsewhereError, WorkerSlot
from robotouille_server.transport import LoopBudget, Peer

DAY_SECONDS = 86_400.0
SPECTATOR = "spectator"


@dataclass(frozen=True, slots=True)
class ShutdownNotice:
    """Message to all clients of a server that stops."""

    reason: str
    hand_over: bool

    def send(self, peer: Peer) -> None:
        """Close a connection; clients reconnect if another process takes over."""
        if self.hand_over:
            peer.close("server/restart", self.reason, retry=True, status=1012)
        else:
            peer.close("server/stopped", self.reason, status=1001)


@dataclass(slots=True)
class Shutdown:
    """State of a server's shutdown."""

    begun: bool = False
    notice: ShutdownNotice | None = None


class AnswerLater(Exception):  # noqa: N818
    """Not an error: `work` answers the request, and nothing is read from the client until then."""

    def __init__(self, work: Coroutine[Any, Any, None]) -> None:
        super().__init__("the answer comes later")
        self.work = work


class Opening(BaseModel):
    """Request to open an episode.

    Attributes:
        request: The options of the episode.
        owner: The pseudonym of the participant who opens it.
        asker: The session and the pseudonym of the participant.
        host: True if the participant may open episodes that are not rematches.
    """

    request: messages.Create
    owner: str = ""
    asker: tuple[str, ...] = ()
    host: bool = True


class ClusterRequests(Protocol):
    """Requests that any node of a cluster answers; see `ClusterService`."""

    @property
    def nodes(self) -> list[str]:
        """Addresses of the other nodes."""

    @property
    def cut_off(self) -> bool:
        """True while clients must go to another node."""

    async def look(self, code: str) -> None: ...

    async def mirror(self, episode: str) -> JoinedRoom | None: ...

    def mirror_of(self, session: str, episode: str) -> JoinedRoom | None: ...

    async def create(
        self, opening: Opening, finding: AbstractContextManager[None] | None = None
    ) -> messages.Created: ...

    async def close(self, message: messages.Close, owner: str, *, operator: bool) -> str: ...

    async def list(
        self, request: messages.ListEpisodes, only: str, owner: str, *, operator: bool
    ) -> messages.Episodes: ...

    def using_token(
        self, session: str, limits: SessionLimits
    ) -> AbstractAsyncContextManager[None]: ...


@dataclass(slots=True)
class Services:
    """Parts of a server that all its connections use.

    `cluster` is None unless the server is a node of a cluster. `plan_simulation` is held while a
    thread simulates the plan of a task.
    """

    settings: ServerSettings
    metrics: Metrics
    lobby: Lobby
    sessions: Sessions
    tokens: Tokens
    used_tokens: UsedTokens
    connection_limiter: ConnectionLimiter
    code_guesses: CodeGuessLimiter
    loop_budget: LoopBudget
    shutdown: Shutdown
    worker: WorkerSlot
    cluster: ClusterRequests | None = None
    plan_simulation: asyncio.Lock = field(default_factory=asyncio.Lock)

    def seat_tokens(
        self, room: Room, participants: Mapping[str, str], owner: str
    ) -> dict[str, str]:
        """Return a token for each seat, valid for a day after the reservation of the room ends.

        Args:
            room: The room of the episode.
            participants: The owner's names for participants, by player.
            owner: The pseudonym of the participant who opened the episode.
        """
        return {
            player: self.tokens.mint_role(
                Role.PLAYER, subject, seconds=_validity(room), episode=room.id, seat=player
            )
            for player, subject in _subjects(room, participants, owner).items()
        }

    def seat_links(self, room: Room, participants: Mapping[str, str], owner: str) -> dict[str, str]:
        """Return a personal link for each seat, with the subject and validity of its token.

        A link is the part of the page's address after `#`.
        """
        return {
            player: self.tokens.mint_link(
                subject, seconds=_validity(room), code=room.code, seat=player
            )
            for player, subject in _subjects(room, participants, owner).items()
        }


def _validity(room: Room) -> float:
    return (room.episode.rules.open_for or 0.0) + DAY_SECONDS


def _subjects(room: Room, participants: Mapping[str, str], owner: str) -> dict[str, str]:
    """Return the pseudonym of the participant for each seat."""
    return {
        player: _pseudonym(owner, participants[player])
        if player in participants
        else f"{room.id}-{number}"
        for number, player in enumerate(room.world.players, 1)
    }


def open_episode(services: Services, opening: Opening) -> tuple[Room, messages.Created]:
    """Open an episode in this process; return its room, and the answer without a `ref`."""
    message, owner = opening.request, opening.owner
    asker = Asker(frozenset(opening.asker), opening.host)
    room = services.lobby.create(message, owner=owner, asker=asker)
    created = messages.Created(ref=message.ref, episode=room.id, code=room.code)
    if message.tokens:
        tokens = services.seat_tokens(room, message.participants, owner)
        links = services.seat_links(room, message.participants, owner)
        created = created.model_copy(update={"tokens": tokens, "links": links})
    return room, created


async def simulate_plan(services: Services, request: messages.Create) -> None:
    """Simulate the plan that the step limit of an episode depends on, if it is not known yet.

    A thread does this, because the simulation can take 0.2 s.

    Raises:
        ProtocolError: The request is invalid.
    """
    task = services.lobby.task_to_simulate(request)
    if task is not None:
        async with services.plan_simulation:
            await asyncio.to_thread(retimed_length, task)


def _pseudonym(owner: str, participant: str) -> str:
    """Return the pseudonym of a participant, which is the same in all episodes of an owner.

    The owner is part of the digest, so two owners cannot link their participants.
    """
    digest = hashlib.sha256(f"{owner}\0{participant}".encode()).hexdigest()
    return f"participant-{digest[:16]}"


class Requests:
    """Answers the requests of one session over one connection.

    `counted` is the visitor that rate limits count the connection for.
    """

    __slots__ = ("_counted", "_peer", "_services", "_session")

    def __init__(self, services: Services, peer: Peer, session: Session, counted: Visitor) -> None:
        self._services = services
        self._peer = peer
        self._session = session
        self._counted = counted

    def handle(self, message: messages.ClientMessage) -> None:
        """Perform a request and answer it; raise ProtocolError if it is refused."""
        check_permission(self._session.role, message)
        HANDLERS[type(message)](self, message)

    def _hello(self, message: messages.Hello) -> None:
        raise ProtocolError("protocol/hello", "hello was received already", "type")

    # Episodes

    def _list(self, message: messages.ListEpisodes) -> None:
        only, operator = self._session.limits.only_episode, self._session.role is Role.OPERATOR
        cluster, lobby, owner = self._services.cluster, self._services.lobby, self._owner
        if cluster is not None:
            listing = cluster.list(message, only, owner, operator=operator)
            raise AnswerLater(self._answer_with(listing))
        self._peer.answer(lobby.infos(message, only, owner, operator=operator))

    async def _answer_with(self, work: Awaitable[messages.Message]) -> None:
        self._peer.answer(await work)

    def _create(self, message: messages.Create) -> None:
        session, services = self._session, self._services
        check_opening(session.limits.only_episode)
        asker, host = (session.id, session.participant), session.role.includes(Role.HOST)
        opening = Opening(request=message, owner=self._owner, asker=asker, host=host)
        if services.cluster is not None:
            raise AnswerLater(self._create_in(services.cluster, opening))
        if services.lobby.task_to_simulate(message) is not None:
            raise AnswerLater(self._create_later(opening))
        self._create_now(opening)

    async def _create_later(self, opening: Opening) -> None:
        await simulate_plan(self._services, opening.request)
        self._create_now(opening)

    def _create_now(self, opening: Opening) -> None:
        message = opening.request
        try:
            with self._counting_guesses(message.rematch):
                _, created = open_episode(self._services, opening)
        except ElsewhereError as error:
            self._peer.send(error.moved(message.ref))
            return
        self._peer.send(created)

    async def _create_in(self, cluster: ClusterRequests, opening: Opening) -> None:
        # Many connections may wait for a turn. The check comes after it, when the wrong codes of
        # the others are counted.
        guess = self._counting_guesses(opening.request.rematch)
        try:
            self._peer.answer(await cluster.create(opening, guess))
        except ElsewhereError as error:
            self._peer.send(error.moved(opening.request.ref))

    def _close(self, message: messages.Close) -> None:
        role = self._session.role
        check_opening(self._session.limits.only_episode)
        reason = message.reason or f"closed by the {role}"
        cluster, lobby, operator = (
            self._services.cluster,
            self._services.lobby,
            role is Role.OPERATOR,
        )
        if cluster is not None:
            closing = message.model_copy(update={"reason": reason})
            raise AnswerLater(self._close_anywhere(cluster, closing, operator=operator))
        try:
            room = lobby.close(message.episode, reason, self._owner, operator=operator)
        except ElsewhereError as error:
            self._peer.send(error.moved(message.ref))
            return
        self._peer.send(messages.Closed(ref=message.ref, episode=room.id))

    async def _close_anywhere(
        self, cluster: ClusterRequests, message: messages.Close, *, operator: bool
    ) -> None:
        episode = await cluster.close(message, self._owner, operator=operator)
        self._peer.send(messages.Closed(ref=message.ref, episode=episode))

    @property
    def _owner(self) -> str:
        """Pseudonym with which the session opens episodes; empty without a token."""
        participant = self._session.participant
        return participant if participant != self._session.id else ""

    # Joining and leaving

    def _join(self, message: messages.Join, *, prepared: bool = False) -> None:
        session, cluster = self._session, self._services.cluster
        if session.room is not None:
            where = session.room.code
            raise ProtocolError(
                "episode/joined", f"you are in {where} already; leave it first", "type"
            )
        if cluster is not None and not prepared:
            known = self._known_as(message)
            watches = known == "elsewhere" and message.role == SPECTATOR
            if known == "unknown" or watches or (known == "here" and session.limits.once):
                raise AnswerLater(self._join_later(cluster, message, known))
        try:
            room = self._find(message.episode)
        except ElsewhereError as error:
            self._peer.send(error.moved(message.ref))
            return
        # The token is used up by the join, not by `hello`: a client that fails to join can try
        # again. See `UsedTokens`.
        with self._using_token():
            self._enter(room, message)

    def _enter(self, room: JoinedRoom, message: messages.Join) -> None:
        request = message.model_copy(update={"seat": self._seat_for(message, room)})
        room.enter(self._session, request, self._services.settings.max_spectators)

    def _known_as(self, message: messages.Join) -> str:
        """Return whether a node of a cluster has an episode `here`, or elsewhere, or `unknown`."""
        try:
            self._services.lobby.find(message.episode)
        except ElsewhereError:
            return "elsewhere"
        except ProtocolError as error:
            return "unknown" if error.code == ErrorCode.EPISODE_UNKNOWN else "elsewhere"
        return "here"

    async def _join_later(
        self, cluster: ClusterRequests, message: messages.Join, known: str
    ) -> None:
        self._services.code_guesses.check(self._counted, self._now())
        if known != "elsewhere":
            await cluster.look(message.episode)
            known = self._known_as(message)
        limits, mirror = self._session.limits, None
        if known == "elsewhere" and message.role == SPECTATOR:
            mirror = await self._mirror(cluster, message)
        # The node that the client stays at uses the token up. Elsewhere it has another session.
        here = known == "here" or mirror is not None
        use = cluster.using_token(self._session.id, limits)
        async with use if limits.once and here else nullcontext():
            if not self._peer.open:
                return
            if mirror is not None:
                self._enter(mirror, message)
            else:
                self._join(message, prepared=True)

    async def _mirror(self, cluster: ClusterRequests, message: messages.Join) -> JoinedRoom | None:
        """Return a room for spectators of another node's episode; None without an answer."""
        try:
            self._find(message.episode)
        except ElsewhereError as error:
            return await cluster.mirror(error.episode)
        return None

    def _using_token(self) -> AbstractContextManager[None]:
        """Return a context for a join that uses up a token for one session."""
        session, limits = self._session, self._session.limits
        if not limits.once:
            return nullcontext()
        used = self._services.used_tokens
        return used.used_by(session.id, limits.token_id, limits.role_expires)

    def _seat_for(self, message: messages.Join, room: JoinedRoom) -> str | None:
        """Return the seat to request. A code that the token is not for counts as a wrong code."""
        only, seat = self._session.limits.only_episode, self._session.limits.only_seat
        try:
            return check_join(message, only=only, seat=seat, episode=room.id, code=room.code)
        except ProtocolError as error:
            # Without this, a token for one episode would allow unlimited guesses of other episodes'
            # codes.
            if error.code == "auth/episode":
                self._services.code_guesses.wrong(self._counted, self._now())
            raise

    def _find(self, name: str) -> Room:
        """Return the room with a code; limit wrong codes, so that codes cannot be guessed.

        Hosts may also use ids, because they may list all episodes.
        """
        lobby, session = self._services.lobby, self._session
        with self._counting_guesses(name):
            if session.role.includes(Role.HOST) and not session.limits.only_episode:
                return lobby.find(name)
            return lobby.find_by_code(name, session.limits.only_episode)

    @contextmanager
    def _counting_guesses(self, name: str | None) -> Iterator[None]:
        """Count a wrong id or code of an episode; refuse the request after too many of them."""
        if name is None:
            yield
            return
        now, codes = self._now(), self._services.code_guesses
        codes.check(self._counted, now)
        try:
            yield
        except ProtocolError as error:
            # Codes have 45 bits, which is enough only while guesses are limited (docs/security.md,
            # "Finding episodes").
            if error.code in (ErrorCode.EPISODE_UNKNOWN, "auth/episode"):
                codes.wrong(self._counted, now)
            raise

    def _now(self) -> float:
        return self._peer.socket.loop.time()

    def _ready(self, message: messages.Ready) -> None:
        self._room.set_ready(self._session, message.ready)

    def _leave(self, message: messages.Leave) -> None:
        room = self._room
        room.leave(self._session)
        self._peer.send(messages.Left(ref=message.ref, episode=room.id))

    # In an episode

    def _act(self, message: messages.Act) -> None:
        session = self._session
        room = session.room
        if room is None:
            self._peer.send(unheard(message, session, 0, "episode/none", "join an episode first"))
            return
        step = room.step
        room.act(session, message)
        # Without the wall clock, an action may complete a step, which takes much longer than
        # reading the message.
        if taken := room.step - step:
            self._services.loop_budget.spend(taken * STEP_COST)

    def _say(self, message: messages.Say) -> None:
        self._room.say(self._session, message.text)

    def _signal(self, message: messages.Signal) -> None:
        self._room.signal(self._session, message)

    def _note(self, message: messages.Note) -> None:
        self._room.note(self._session, message)

    def _resync(self, message: messages.Resync) -> None:
        self._room.ask_snapshot(self._session)

    def _get_rendering(self, message: messages.GetRendering) -> None:
        answer = self._rendering(message.ref, self._room, self._assets)
        raise AnswerLater(self._answer_with(answer))

    async def _rendering(
        self, ref: int | None, room: JoinedRoom, assets: TaskAssets | None
    ) -> messages.Rendering:
        # The first request for a task simulates its plan, which can take 0.2 s. One search at a
        # time, because clients that ask at once usually need the same one.
        async with self._services.plan_simulation:
            limits = await asyncio.to_thread(room.find_star_limits)
        stars = None if limits is None else list(limits)
        if assets is None:
            return messages.Rendering(ref=ref, stars=stars)
        return messages.Rendering(
            ref=ref,
            rendering=dict(assets.rendering),
            bindings=dict(assets.bindings),
            pictures=dict(assets.pictures),
            stars=stars,
        )

    def _get_picture(self, message: messages.GetPicture) -> None:
        assets = self._assets
        if assets is None or message.digest not in assets.pictures.values():
            text = "this episode has no such picture"
            raise ProtocolError("message/invalid-field", text, "digest")
        data = b64encode(self._services.lobby.tasks.picture(message.digest)).decode()
        self._peer.answer(messages.Picture(ref=message.ref, digest=message.digest, data=data))

    @property
    def _assets(self) -> TaskAssets | None:
        """Rendering and pictures of the session's task; None for a shipped task."""
        return self._services.lobby.tasks.assets(self._room.task)

    @property
    def _room(self) -> JoinedRoom:
        """Room of the session. Raises ProtocolError `episode/none` if it is in no room."""
        room = self._session.room
        if room is None:
            raise ProtocolError("episode/none", "join an episode first", "type")
        return room


def unheard(
    act: messages.Act, session: Session | None, step: int, code: str, reason: str
) -> messages.Rejected:
    """Return the answer to an action that reaches no room."""
    seat = session.seat_shown(act.seat) if session is not None else ""
    return messages.Rejected(
        seq=act.seq, step=step, action="", reasons=[reason], code=code, seat=seat
    )


HANDLERS: dict[type[messages.Message], Callable[[Requests, Any], None]] = {
    messages.ListEpisodes: Requests._list,
    messages.Create: Requests._create,
    messages.Close: Requests._close,
    messages.Join: Requests._join,
    messages.Ready: Requests._ready,
    messages.Leave: Requests._leave,
    messages.Act: Requests._act,
    messages.Say: Requests._say,
    messages.Signal: Requests._signal,
    messages.Note: Requests._note,
    messages.GetRendering: Requests._get_rendering,
    messages.GetPicture: Requests._get_picture,
    messages.Resync: Requests._resync,
    messages.Hello: Requests._hello,
}
