"""One connection's side of the protocol: `hello`, then what its budget allows."""

from __future__ import annotations

import asyncio

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.release import RELEASE
from robotouille_server.auth import CountedConnection, TooManyConnectionsError, counted_as
from robotouille_server.conversation.message_budget import COSTS, PACED, FloodError, MessageBudget
from robotouille_server.conversation.requests import Requests, unheard
from robotouille_server.conversation.services import Services
from robotouille_server.rooms.session import Session
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.timer_queue import LATE
from robotouille_server.runtime.workers import ElsewhereError
from robotouille_server.transport import Peer

__all__ = ["Conversation"]


class EndMissedError(Exception):
    """Somebody comes back to an episode that has no room, and may be over."""

    def __init__(self, episode: str) -> None:
        super().__init__(episode)
        self.episode = episode


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
        "_requests",
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
        self._budget = MessageBudget(services.settings.messages_per_second, self._loop.time())
        self._requests: Requests | None = None
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
            affordable = self._budget.charge(
                self._loop.time(), len(payload), peer.take_answered(), greeted=session is not None
            )
            message = self._decode(payload)
            ref = None if type(message) is messages.Act else getattr(message, "ref", None)
            self._handle(message, affordable)
        except FloodError:
            services.metrics.dropped.labels("flood").inc()
            peer.close("rate/limited", "far too many messages")
        except ProtocolError as error:
            self._answer_error(error, ref)
        except Exception:
            self._answer_failure(ref)
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

    def _handle(self, message: messages.ClientMessage, affordable: bool) -> None:
        requests = self._requests
        extra = COSTS.get(type(message), 1) - 1
        if extra:
            self._services.loop_budget.spend(extra)
            if not isinstance(message, messages.Resync):
                self.peer.socket.give_way()
        if isinstance(message, PACED) and requests is not None:
            try:
                requests.handle(message)
            finally:
                self._pace()
        elif not affordable or (extra and not self._budget.take(self._loop.time(), extra)):
            self._refuse_over_limit(message)
        elif requests is None:
            self._handle_hello(message)
        else:
            requests.handle(message)

    def _pace(self) -> None:
        """Read on once there is a reserve in the budget for what else may come."""
        seconds = self._budget.pause(self._loop.time())
        if seconds > 0 and self._pace_timer is None:
            self.peer.socket.pause_reading("pace")
            self._pace_timer = self._loop.call_later(seconds, self._paced)

    def _paced(self) -> None:
        self._pace_timer = None
        self.peer.socket.resume_reading("pace")

    def _refuse_over_limit(self, message: messages.ClientMessage) -> None:
        """Too many messages: an action is rejected, anything else an error."""
        code, reason, session = "rate/limited", self._budget.exceeded, self.session
        if not isinstance(message, messages.Act):
            raise ProtocolError(code, reason)
        if session is not None and session.room is not None:
            session.room.refuse(session, message, ProtocolError(code, reason))
            return
        self._services.metrics.errors.labels(code).inc()
        self.peer.send(unheard(message, session, message.basis or 0, code, reason))

    def _answer_failure(self, ref: int | None) -> None:
        """Answer what has failed for no fault of the client's; called while that is handled."""
        get_logger().exception("a message failed")
        failure = ProtocolError("server/internal", "the server failed to handle this")
        self._answer_error(failure, ref)

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
            raise ProtocolError("protocol/version", _other_version(message.protocol), "protocol")
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
        self._welcome(session, message, resumed=resumed)

    def _welcome(self, session: Session, hello: messages.Hello, *, resumed: bool) -> None:
        """Answer a hello; who comes back is sent what they have missed."""
        services, room = self._services, session.room
        welcome = messages.Welcome(
            ref=hello.ref,
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
                room.connection_back(session, hello.seen)
            elif hello.seen is not None:
                reason = "you are no longer in this episode"
                self.peer.send(messages.Left(episode=hello.seen.episode, reason=reason))

    async def _handle_hello_later(self, hello: messages.Hello, episode: str) -> None:
        """Find the end of an episode beside the games; what the client says meanwhile waits."""
        try:
            await self._services.lobby.show_end(episode)
            if self.peer.open and self._services.shutdown_notice() is None:
                self._handle_hello(hello, shown=True)
        except ProtocolError as error:
            self._answer_error(error, hello.ref)
        except Exception:
            self._answer_failure(hello.ref)
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
        self._requests = Requests(self._services, self.peer, session, self._counted)
        session.visitor = self._connection.who
        session.counted_connection = self._connection
        self._services.sessions.connected(session)
        if self._services.settings.record_addresses:
            address = self._connection.who.address
            get_logger().info("participant connected", session=session.id, address=address)
        if old is not None:
            old.close("session/elsewhere", "the connection was resumed elsewhere")


def _other_version(protocol: int) -> str:
    """What somebody is told who speaks another version than this server."""
    older = "the server" if protocol > messages.PROTOCOL_VERSION else "your program"
    speaks = f"version {protocol}; this server speaks {messages.PROTOCOL_VERSION}"
    return f"{speaks}: {older} is the older one and has to be updated"
