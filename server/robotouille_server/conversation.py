"""One connection's side of the protocol: hello, then requests."""

from __future__ import annotations

import asyncio
import hashlib
from base64 import b64encode
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.release import RELEASE
from robotouille_server.auth import (
    CodeGuessLimiter,
    ConnectionLimiter,
    CountedConnection,
    Role,
    Tokens,
    TooManyConnectionsError,
    UsedTokens,
    check_join,
    check_opening,
    check_permission,
    counted_as,
)
from robotouille_server.rooms.lobby import Lobby
from robotouille_server.rooms.room import Room
from robotouille_server.rooms.session import JoinedRoom, Session
from robotouille_server.rooms.sessions import Sessions
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.task_folder import Look
from robotouille_server.runtime.timer_queue import LATE
from robotouille_server.runtime.token_bucket import TokenBucket
from robotouille_server.runtime.workers import ElsewhereError
from robotouille_server.transport import LoopBudget, Peer

__all__ = ["Conversation", "Services", "ShutdownNotice"]

COSTS: dict[type[messages.Message], float] = {
    messages.Create: 10,
    messages.Close: 2,
    messages.Join: 5,
    messages.Resync: 5,
    messages.ListEpisodes: 3,
    messages.GetRendering: 3,
    messages.GetPicture: 2,
}
"""What a message takes of a connection's budget, where that is not one. Each KiB of it, and of
the snapshots and lists that it is answered with, is one more. After each of these everybody else
has a turn; of resyncs all those of a turn are answered together."""
PACED = (messages.Create, messages.Close)
"""What hosts send by the hundred, for a study. It costs a connection no more than any other
message, and is never refused for its number: what is beyond the limit is read later."""
KIB = 1024
MAX_HELLO_BYTES = 8 * KIB
"""Of a message before `hello` is answered: that is the longest anybody needs."""
DAY_SECONDS = 86_400.0
MAX_REFUSED = 200
"""Messages over the limit, in about a minute, after which a connection is closed."""


class FloodError(Exception):
    """A connection has sent far more than it may."""


class EndMissedError(Exception):
    """Somebody comes back to an episode that has no room, and may be over."""

    def __init__(self, episode: str) -> None:
        super().__init__(episode)
        self.episode = episode


@dataclass(frozen=True, slots=True)
class ShutdownNotice:
    """What a server that stops sends to everybody."""

    reason: str
    hand_over: bool

    def send(self, peer: Peer) -> None:
        """Close a connection: for good, or until the next process is there."""
        if self.hand_over:
            peer.close("server/restart", self.reason, retry=True, status=1012)
        else:
            peer.close("server/stopped", self.reason, status=1001)


@dataclass(frozen=True, slots=True)
class Services:
    """What all connections of a server use. `shutdown_notice` is None while the server goes on."""

    settings: ServerSettings
    metrics: Metrics
    lobby: Lobby
    sessions: Sessions
    tokens: Tokens
    used_tokens: UsedTokens
    connection_limiter: ConnectionLimiter
    code_guesses: CodeGuessLimiter
    loop_budget: LoopBudget
    shutdown_notice: Callable[[], ShutdownNotice | None]

    def seat_tokens(
        self, room: Room, participants: Mapping[str, str], owner: str
    ) -> dict[str, str]:
        """A token for each seat of an episode, good for a day after it may have begun.

        Args:
            participants: Who is to have it, by player, in the owner's words.
            owner: Who has opened the episode.
        """
        seconds = (room.episode.rules.open_for or 0.0) + DAY_SECONDS
        return {
            player: self.tokens.mint_role(
                Role.PLAYER,
                _pseudonym(owner, participants[player])
                if player in participants
                else f"{room.id}-{number}",
                seconds=seconds,
                episode=room.id,
                seat=player,
            )
            for number, player in enumerate(room.world.players, 1)
        }


class Conversation:
    """Takes the messages of one connection, as they come, and answers each."""

    __slots__ = (
        "_budget",
        "_connection",
        "_counted",
        "_hello_task",
        "_hello_timer",
        "_loop",
        "_pace_timer",
        "_refusals",
        "_services",
        "peer",
        "session",
    )

    def __init__(self, services: Services, peer: Peer, connection: CountedConnection) -> None:
        self.session: Session | None = None
        self.peer = peer
        self._services = services
        self._connection = connection
        self._counted = connection.who
        self._loop = asyncio.get_running_loop()
        self._budget = TokenBucket(services.settings.messages_per_second, self._loop.time())
        self._refusals = TokenBucket(MAX_REFUSED / 60, self._loop.time(), MAX_REFUSED)
        self._hello_timer: asyncio.TimerHandle | None = None
        self._hello_task: asyncio.Task[None] | None = None
        self._pace_timer: asyncio.TimerHandle | None = None
        self._await_hello()

    def _await_hello(self) -> None:
        seconds = self._services.settings.hello_seconds
        self._hello_timer = self._loop.call_later(seconds, self._hello_timeout)

    def close(self) -> None:
        """The connection is gone."""
        if self._hello_timer is not None:
            self._hello_timer.cancel()
        if self._hello_task is not None:
            self._hello_task.cancel()
        if self._pace_timer is not None:
            self._pace_timer.cancel()

    def _hello_timeout(self) -> None:
        if self._hello_timer is not None and self._loop.time() > self._hello_timer.when() + LATE:
            # The server stood still, and has not read what came meanwhile.
            self._await_hello()
            return
        if self._hello_task is not None:  # It has said hello, and is being looked for.
            self._await_hello()
            return
        self._services.metrics.dropped.labels("silent").inc()
        self.peer.close("auth/silent", "no hello in time", retry=True)

    def receive(self, payload: bytes | str) -> None:
        """Take one message; whatever is wrong with it is answered."""
        peer, services, session = self.peer, self._services, self.session
        if not peer.open or (session is not None and session.peer is not peer):
            return
        notice = services.shutdown_notice()
        if notice is not None:
            notice.send(peer)
            return
        services.metrics.received += 1
        peer.received += 1
        peer.received_bytes += len(payload)
        ref = None
        try:
            affordable = self._charge(payload)
            message = self._decode(payload)
            ref = None if type(message) is messages.Act else getattr(message, "ref", None)
            self._handle(message, affordable)
        except FloodError:
            services.metrics.dropped.labels("flood").inc()
            peer.close("rate/limited", "far too many messages")
        except ProtocolError as error:
            self._answer_error(error, ref)
        except Exception:
            get_logger().exception("a message failed")
            failure = ProtocolError("server/internal", "the server failed to handle this")
            self._answer_error(failure, ref)
        peer.throttle()

    def _decode(self, payload: bytes | str) -> messages.ClientMessage:
        """A message; one of a player that cannot be read is recorded."""
        try:
            return self.peer.codec.decode_client(payload)
        except ProtocolError as error:
            session = self.session
            if session is not None and session.room is not None:
                session.room.record_unreadable(session, payload, error)
            raise

    def _charge(self, payload: bytes | str) -> bool:
        """Take a message off the budget, and what the last one was answered with; whether there
        was so much. One that is refused is not free either: it was read, and is answered."""
        size = len(payload)
        if self.session is None and size > MAX_HELLO_BYTES:
            self._charge_refused(size)
            message = f"{size:,} bytes; at most {MAX_HELLO_BYTES:,} are read before hello"
            raise ProtocolError("message/too-large", message)
        now = self._loop.time()
        self._budget.owe(now, self.peer.take_answered() / KIB)
        if self._budget.take(now, 1 + size / KIB):
            return True
        self._charge_refused(size)
        if size > MAX_HELLO_BYTES:
            raise ProtocolError("rate/limited", self._limit)  # Not worth looking for its `ref`.
        return False

    def _charge_refused(self, size: int) -> None:
        """One more message that is refused; a long one counts for more."""
        if not self._refusals.take(self._loop.time(), 1 + size / MAX_HELLO_BYTES):
            raise FloodError

    @property
    def _limit(self) -> str:
        return f"more than {self._services.settings.messages_per_second:g} messages a second"

    def _handle(self, message: messages.ClientMessage, affordable: bool) -> None:
        extra = COSTS.get(type(message), 1) - 1
        if extra:
            self._services.loop_budget.spend(extra)
            if not isinstance(message, messages.Resync):
                self.peer.socket.give_way()
        if isinstance(message, PACED) and self.session is not None:
            check_permission(self.session.role, message)
            try:
                HANDLERS[type(message)](self, self.session, message)
            finally:
                self._pace()
        elif not affordable or (extra and not self._budget.take(self._loop.time(), extra)):
            self._refuse_over_limit(message)
        elif self.session is None:
            self._handle_hello(message)
        else:
            check_permission(self.session.role, message)
            HANDLERS[type(message)](self, self.session, message)

    def _pace(self) -> None:
        """Read on once there is a reserve in the budget for what else may come."""
        reserve = self._services.settings.messages_per_second / 4
        lacking = reserve - self._budget.left(self._loop.time())
        if lacking > 0 and self._pace_timer is None:
            self.peer.socket.pause_reading("pace")
            seconds = lacking / self._services.settings.messages_per_second
            self._pace_timer = self._loop.call_later(seconds, self._paced)

    def _paced(self) -> None:
        self._pace_timer = None
        self.peer.socket.resume_reading("pace")

    def _refuse_over_limit(self, message: messages.ClientMessage) -> None:
        """Too many messages: an action is rejected, anything else an error."""
        code, reason = "rate/limited", self._limit
        if not isinstance(message, messages.Act):
            raise ProtocolError(code, reason)
        if self.session is not None and self.session.room is not None:
            self.session.room.refuse(self.session, message, ProtocolError(code, reason))
            return
        self._services.metrics.errors.labels(code).inc()
        self._reject(message, message.basis or 0, code, reason)

    def _reject(self, act: messages.Act, step: int, code: str, reason: str) -> None:
        """Answer an action of which the room does not hear."""
        seat = self.session.seat_shown(act.seat) if self.session is not None else ""
        rejected = messages.Rejected(
            seq=act.seq, step=step, action="", reasons=[reason], code=code, seat=seat
        )
        self.peer.send(rejected)

    def _answer_error(self, error: ProtocolError, ref: int | None) -> None:
        self._services.metrics.errors.labels(error.code).inc()
        self.peer.send(
            messages.Error(
                ref=ref if ref is not None else error.ref,
                code=error.code,
                message=error.message[:1000],
                field=error.field,
            )
        )

    # Hello

    def _handle_hello(self, message: messages.ClientMessage, *, shown: bool = False) -> None:
        if not isinstance(message, messages.Hello):
            raise ProtocolError("protocol/hello", "say hello first", "type")
        if message.protocol != messages.PROTOCOL_VERSION:
            text = f"version {message.protocol}; this server speaks {messages.PROTOCOL_VERSION}"
            raise ProtocolError("protocol/version", text, "protocol")
        try:
            session, resumed = self._session(message, shown=shown)
        except ElsewhereError as error:
            self.peer.send(error.moved(message.ref))
            return
        except TooManyConnectionsError as error:
            self._services.metrics.dropped.labels("crowded").inc()
            self.peer.close(error.code, error.message, retry=True, status=1013)
            return
        except EndMissedError as error:
            self.peer.socket.pause_reading("hello")
            self._hello_task = self._loop.create_task(
                self._handle_hello_later(message, error.episode)
            )
            return
        except ProtocolError as error:
            if error.code not in ("server/recording", "rate/seats"):
                raise
            self.peer.close(error.code, error.message, retry=True)
            return
        if self._hello_timer is not None:
            self._hello_timer.cancel()
        self._attach(session)
        services = self._services
        room = session.room
        welcome = messages.Welcome(
            ref=message.ref,
            protocol=messages.PROTOCOL_VERSION,
            server=RELEASE,
            session=session.id,
            resume=services.sessions.resume_token(session),
            resumed=resumed,
            role=session.role.value,
            grace=room.episode.rules.grace if room is not None else services.settings.grace,
            readiness=True,
        )
        self.peer.send(welcome)
        if resumed:
            services.metrics.resumed.inc()
            if room is not None:
                room.connection_back(session, message.seen)
            elif message.seen is not None:
                reason = "you are no longer in this episode"
                self.peer.send(messages.Left(episode=message.seen.episode, reason=reason))

    async def _handle_hello_later(self, hello: messages.Hello, episode: str) -> None:
        """Find the end of an episode beside the games; what the client says meanwhile waits."""
        try:
            await self._services.lobby.show_end(episode)
            if self.peer.open and self._services.shutdown_notice() is None:
                self._handle_hello(hello, shown=True)
        except ProtocolError as error:
            self._answer_error(error, hello.ref)
        except Exception:
            get_logger().exception("a message failed")
            failure = ProtocolError("server/internal", "the server failed to handle this")
            self._answer_error(failure, hello.ref)
        self._hello_task = None
        self.peer.socket.resume_reading("hello")

    def _session(self, hello: messages.Hello, *, shown: bool) -> tuple[Session, bool]:
        """A newcomer's session, or that of a connection which was lost; EndMissedError if its
        episode may have ended, and what it was at last is not `shown` yet."""
        services, visitor = self._services, self._connection.who
        if hello.resume is None:
            role, grant = services.sessions.role_of(hello, visitor)
            self._take_slot(grant.subject if grant is not None else "")
            return services.sessions.open(hello, role, grant), False
        resume = services.tokens.check_resume(hello.resume)
        services.sessions.check_may_return(resume)
        room = services.lobby.home_of(resume.session, resume.episode)
        unknown = room is None and resume.session not in services.sessions.by_id
        if (
            unknown
            and not shown
            and resume.episode
            and services.lobby.may_have_ended(resume.episode)
        ):
            raise EndMissedError(resume.episode)
        role = services.sessions.judge(resume, room, visitor)
        if room is not None:
            room.check_return(resume.session)
        known = services.sessions.by_id.get(resume.session)
        subject = "" if resume.anonymous else resume.participant
        self._take_slot(subject, known.counted_connection if known is not None else None)
        session = services.sessions.resume(resume, room, role)
        session.view = hello.view or session.view
        return session, True

    def _take_slot(self, subject: str, instead_of: CountedConnection | None = None) -> None:
        """From here on limits count the connection by the subject of its token, if it has one."""
        counted = counted_as(self._connection.who, subject)
        self._services.connection_limiter.admit(self._connection, counted, instead_of)
        self._counted = counted

    def _attach(self, session: Session) -> None:
        """This is the session's connection from now on; an earlier one is told so."""
        old, session.peer = session.peer, self.peer
        if old is not None:
            session.earlier_bytes += old.received_bytes
        self.session = session
        session.visitor = self._connection.who
        session.counted_connection = self._connection
        self._services.sessions.connected(session)
        if self._services.settings.record_addresses:
            address = self._connection.who.address
            get_logger().info("participant connected", session=session.id, address=address)
        if old is not None:
            old.close("session/elsewhere", "the connection was resumed elsewhere")

    # Requests

    def _hello_again(self, session: Session, message: messages.Hello) -> None:
        raise ProtocolError("protocol/hello", "you have said hello already", "type")

    def _list(self, session: Session, message: messages.ListEpisodes) -> None:
        owner, operator = _owner(session), session.role is Role.OPERATOR
        lobby = self._services.lobby
        self.peer.answer(lobby.infos(message, session.only_episode, owner, operator=operator))

    def _create(self, session: Session, message: messages.Create) -> None:
        check_opening(session.only_episode)
        asker = (session.id, session.participant)
        try:
            room = self._services.lobby.create(message, owner=_owner(session), asker=asker)
        except ElsewhereError as error:
            self.peer.send(error.moved(message.ref))
            return
        tokens = (
            self._services.seat_tokens(room, message.participants, _owner(session))
            if message.tokens
            else {}
        )
        created = messages.Created(ref=message.ref, episode=room.id, code=room.code, tokens=tokens)
        self.peer.send(created)

    def _close(self, session: Session, message: messages.Close) -> None:
        check_opening(session.only_episode)
        owner, operator = _owner(session), session.role is Role.OPERATOR
        reason = message.reason or f"closed by the {session.role}"
        try:
            room = self._services.lobby.close(message.episode, reason, owner, operator=operator)
        except ElsewhereError as error:
            self.peer.send(error.moved(message.ref))
            return
        self.peer.send(messages.Closed(ref=message.ref, episode=room.id))

    def _join(self, session: Session, message: messages.Join) -> None:
        if session.room is not None:
            where = session.room.code
            raise ProtocolError("episode/joined", f"you are in {where}; leave it first", "type")
        try:
            room = self._find(message.episode)
        except ElsewhereError as error:
            self.peer.send(error.moved(message.ref))
            return
        seat = self._seat_for(session, message, room)
        request = message.model_copy(update={"seat": seat})
        with self._using_token(session):
            room.enter(session, request, self._services.settings.max_spectators)

    def _using_token(self, session: Session) -> AbstractContextManager[None]:
        """Around a join: who came with a token that is good for one session uses it up."""
        if not session.once:
            return nullcontext()
        used = self._services.used_tokens
        return used.used_by(session.id, session.token_id, session.role_expires)

    def _seat_for(self, session: Session, message: messages.Join, room: Room) -> str | None:
        """The seat to ask for. A code outside of what the token is for is a wrong one."""
        only, seat = session.only_episode, session.only_seat
        try:
            return check_join(message, only=only, seat=seat, episode=room.id, code=room.code)
        except ProtocolError as error:
            if error.code == "auth/episode":
                self._services.code_guesses.wrong(self._counted, self._loop.time())
            raise

    def _find(self, name: str) -> Room:
        """The room of a code; whoever guesses codes has to wait soon."""
        now, codes = self._loop.time(), self._services.code_guesses
        codes.check(self._counted, now)
        try:
            return self._services.lobby.find(name)
        except ProtocolError as error:
            if error.code == "episode/unknown":
                codes.wrong(self._counted, now)
            raise

    def _ready(self, session: Session, message: messages.Ready) -> None:
        self._room(session).set_ready(session, message.ready)

    def _leave(self, session: Session, message: messages.Leave) -> None:
        room = self._room(session)
        room.leave(session)
        self.peer.send(messages.Left(ref=message.ref, episode=room.id))

    def _act(self, session: Session, message: messages.Act) -> None:
        if session.room is not None:
            session.room.act(session, message)
        else:
            self._reject(message, 0, "episode/none", "join an episode first")

    def _say(self, session: Session, message: messages.Say) -> None:
        self._room(session).say(session, message.text)

    def _note(self, session: Session, message: messages.Note) -> None:
        self._room(session).note(session, message)

    def _get_rendering(self, session: Session, message: messages.GetRendering) -> None:
        look = self._look(session)
        if look is None:
            self.peer.answer(messages.Rendering(ref=message.ref))
            return
        self.peer.answer(
            messages.Rendering(
                ref=message.ref,
                rendering=dict(look.rendering),
                bindings=dict(look.bindings),
                pictures=dict(look.pictures),
            )
        )

    def _get_picture(self, session: Session, message: messages.GetPicture) -> None:
        look = self._look(session)
        if look is None or message.digest not in look.pictures.values():
            text = "this episode has no such picture"
            raise ProtocolError("message/invalid-field", text, "digest")
        data = b64encode(self._services.lobby.tasks.picture(message.digest)).decode()
        self.peer.answer(messages.Picture(ref=message.ref, digest=message.digest, data=data))

    def _look(self, session: Session) -> Look | None:
        """What the task looks like that a session plays or watches; None for a shipped one."""
        return self._services.lobby.tasks.look(self._room(session).episode.world.task.name)

    def _resync(self, session: Session, message: messages.Resync) -> None:
        self._room(session).ask_snapshot(session)

    def _room(self, session: Session) -> JoinedRoom:
        if session.room is None:
            raise ProtocolError("episode/none", "join an episode first", "type")
        return session.room


def _pseudonym(owner: str, participant: str) -> str:
    """Under which somebody is recorded in all episodes of an owner; another one's are others."""
    digest = hashlib.sha256(f"{owner}\0{participant}".encode()).hexdigest()
    return f"participant-{digest[:16]}"


def _owner(session: Session) -> str:
    """The pseudonym under which somebody opens episodes; empty without a token."""
    return session.participant if session.participant != session.id else ""


HANDLERS: dict[type[messages.Message], Callable[[Conversation, Session, Any], None]] = {
    messages.ListEpisodes: Conversation._list,
    messages.Create: Conversation._create,
    messages.Close: Conversation._close,
    messages.Join: Conversation._join,
    messages.Ready: Conversation._ready,
    messages.Leave: Conversation._leave,
    messages.Act: Conversation._act,
    messages.Say: Conversation._say,
    messages.Note: Conversation._note,
    messages.GetRendering: Conversation._get_rendering,
    messages.GetPicture: Conversation._get_picture,
    messages.Resync: Conversation._resync,
    messages.Hello: Conversation._hello_again,
}
