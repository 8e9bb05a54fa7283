"""Protocol of one connection: `hello`, then requests within its budget."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

from robotouille.errors import ProtocolError
from robotouille.installation import RELEASE
from robotouille.protocol import messages
from robotouille_server.auth import (
    CountedConnection,
    ResumeGrant,
    Role,
    TooManyConnectionsError,
    counted_as,
)
from robotouille_server.requests import AnswerLater, Requests, Services, unheard
from robotouille_server.rooms.participants.session import JoinedRoom, Session
from robotouille_server.runtime.budgets import PACED, FloodError, MessageBudget, cost_of
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.timer_queue import LATE
from robotouille_server.runtime.workers import ElsewhereError
from robotouille_server.transport import Peer


class SearchFirstError(Exception):
    """A session comes back to an episode without a room, but `search` may find one."""

    def __init__(self, episode: str, search: Callable[[str], Awaitable[object]]) -> None:
        super().__init__(episode)
        self.episode = episode
        self.search = search


class Conversation:
    """Receives the messages of one connection and answers each."""

    __slots__ = (
        "_answering",
        "_budget",
        "_connection",
        "_counted",
        "_hello_due",
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
        self._hello_due = 0.0
        self._hello_task: asyncio.Task[None] | None = None
        self._pace_timer: asyncio.TimerHandle | None = None
        self._answering: asyncio.Task[None] | None = None
        self._await_hello()

    def _await_hello(self) -> None:
        self._hello_due = self._loop.time() + self._services.settings.hello_seconds
        self._hello_timer = self._loop.call_at(self._hello_due, self._hello_timeout)

    def close(self) -> None:
        """Cancel all timers, because the connection is gone."""
        if self._hello_timer is not None:
            self._hello_timer.cancel()
        if self._hello_task is not None:
            self._hello_task.cancel()
        if self._pace_timer is not None:
            self._pace_timer.cancel()
        if self._answering is not None:
            self._answering.cancel()

    def _hello_timeout(self) -> None:
        if self._loop.time() > self._hello_due + LATE:
            # The server was suspended. `hello` may have arrived but was not read yet.
            self._await_hello()
            return
        # The archive may take longer than `hello_seconds`, which is not the client's fault.
        if self._hello_task is not None:  # `hello` has arrived; its episode is being searched.
            self._await_hello()
            return
        self._services.metrics.dropped.labels("silent").inc()
        self.peer.close("auth/silent", "no hello was received in time", retry=True)

    def receive(self, payload: bytes | str) -> None:
        """Process one message; answer an invalid one by an error."""
        peer, services, session = self.peer, self._services, self.session
        # The buffer may still contain messages of a connection that was closed or replaced.
        if not peer.open or (session is not None and session.peer is not peer):
            return
        if services.shutdown.notice is not None:
            services.shutdown.notice.send(peer)
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
            # Acts have a sequence number instead of a `ref`. Comparing types is quick, and this
            # line runs for every message.
            ref = None if type(message) is messages.Act else getattr(message, "ref", None)
            self._handle(message, affordable)
        except AnswerLater as later:
            self._await_answer(later.work, ref)
        except FloodError:
            services.metrics.dropped.labels("flood").inc()
            peer.close("rate/limited", "far too many messages")
        except ProtocolError as error:
            if not error.code.startswith(("rate/", "server/")):
                self._budget.charge_mistakes(self._loop.time(), 1)
            self._answer_error(error, ref)
        except Exception:
            self._answer_failure(ref)
        session = self.session
        if session is not None and session.mistakes:
            self._budget.charge_mistakes(self._loop.time(), session.mistakes)
            session.mistakes = 0
        if session is not None and session.room is not None and session.room.writing:
            session.room.hold(peer.socket)
        peer.throttle()

    def _await_answer(self, work: Coroutine[Any, Any, None], ref: int | None) -> None:
        """Read nothing more from the client until a request is answered."""
        self.peer.socket.pause_reading("answer")
        self._answering = self._loop.create_task(self._answer_when_done(work, ref))

    async def _answer_when_done(self, work: Coroutine[Any, Any, None], ref: int | None) -> None:
        try:
            await work
        except ProtocolError as error:
            self._answer_error(error, ref)
        except Exception:
            self._answer_failure(ref)
        self._answering = None
        self.peer.socket.resume_reading("answer")

    def _decode(self, payload: bytes | str) -> messages.ClientMessage:
        """Decode a message; record an unreadable one of a player."""
        try:
            return self.peer.codec.decode_client(payload)
        except ProtocolError as error:
            session = self.session
            if session is not None and session.room is not None:
                session.room.record_unreadable(session, payload, error)
            raise

    def _handle(self, message: messages.ClientMessage, affordable: bool) -> None:
        requests = self._requests
        extra = cost_of(message) - 1
        if extra:
            # Expensive messages also use up the budget that all connections share, so that they do
            # not delay steps.
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
        """Stop reading until the budget has a reserve for other messages."""
        seconds = self._budget.pause(self._loop.time())
        if seconds > 0 and self._pace_timer is None:
            self.peer.socket.pause_reading("pace")
            self._pace_timer = self._loop.call_later(seconds, self._paced)

    def _paced(self) -> None:
        self._pace_timer = None
        self.peer.socket.resume_reading("pace")

    def _refuse_over_limit(self, message: messages.ClientMessage) -> None:
        """Refuse a message above the rate limit: an action by `rejected`, others by `error`."""
        code, reason, session = "rate/limited", self._budget.exceeded, self.session
        if not isinstance(message, messages.Act):
            raise ProtocolError(code, reason)
        if session is not None and session.room is not None:
            session.room.refuse(session, message, ProtocolError(code, reason))
            return
        self._services.metrics.errors.labels(code).inc()
        self.peer.send(unheard(message, session, message.basis or 0, code, reason))

    def _answer_failure(self, ref: int | None) -> None:
        """Log the exception that is being handled, and answer with an internal error."""
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
            raise ProtocolError("protocol/hello", "send hello first", "type")
        if message.protocol != messages.PROTOCOL_VERSION:
            raise ProtocolError("protocol/version", _other_version(message.protocol), "protocol")
        cluster = self._services.cluster
        if cluster is not None and cluster.cut_off:
            text = "this node is cut off from the cluster; try another one"
            self.peer.close("server/handover", text, retry=True, status=1013)
            return
        try:
            session, resumed = self._session(message, shown=shown)
        except ElsewhereError as error:
            self.peer.send(error.moved(message.ref))
            return
        except TooManyConnectionsError as error:
            self._services.metrics.dropped.labels("crowded").inc()
            self.peer.close(error.code, error.message, retry=True, status=1013)
            return
        except SearchFirstError as error:
            self.peer.socket.pause_reading("hello")
            self._hello_task = self._loop.create_task(
                self._handle_hello_later(message, error.search(error.episode))
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
        """Answer `hello`; send a returning session what it has missed."""
        services, room = self._services, session.room
        welcome = messages.Welcome(
            ref=hello.ref,
            protocol=messages.PROTOCOL_VERSION,
            server=RELEASE,
            session=session.id,
            resume=services.sessions.resume_token(session),
            resumed=resumed,
            role=session.role.value,
            grace=room.grace if room is not None else services.settings.grace,
            readiness=True,
            opens_limited_sight=services.settings.rules().limited_sight is not None,
            workers=services.worker.addresses() if session.role.includes(Role.HOST) else [],
            nodes=services.cluster.nodes if services.cluster is not None else [],
        )
        self.peer.send(welcome)
        if resumed:
            services.metrics.resumed.inc()
            if room is not None:
                room.connection_back(session, hello.seen)
            elif episode := self._lost_episode(hello):
                reason = "you are no longer in this episode"
                self.peer.send(messages.Left(episode=episode, reason=reason))

    def _lost_episode(self, hello: messages.Hello) -> str:
        """Return the episode to which a client has tried to return; empty without one."""
        if hello.seen is not None or hello.resume is None:
            return hello.seen.episode if hello.seen is not None else ""
        return self._services.tokens.check_resume(hello.resume).episode

    async def _handle_hello_later(self, hello: messages.Hello, search: Awaitable[object]) -> None:
        """Search for an episode, without delaying others, then answer `hello`.

        Until then, no further messages are read from the client.
        """
        try:
            await search
            if self.peer.open and not self._services.shutdown.begun:
                self._handle_hello(hello, shown=True)
        except ProtocolError as error:
            self._answer_error(error, hello.ref)
        except Exception:
            self._answer_failure(hello.ref)
        self._hello_task = None
        self.peer.socket.resume_reading("hello")

    def _session(self, hello: messages.Hello, *, shown: bool) -> tuple[Session, bool]:
        """Return a new session, or the one of a lost connection and True.

        Raises:
            SearchFirstError: The episode may have ended or be elsewhere, and is not `shown` yet.
        """
        services, visitor = self._services, self._connection.who
        if hello.resume is None:
            role, grant = services.sessions.role_of(hello, visitor)
            self._take_slot(grant.subject if grant is not None else "")
            return services.sessions.open(hello, role, grant), False
        resume = services.tokens.check_resume(hello.resume)
        services.sessions.check_may_return(resume)
        room = self._home_of(resume, shown=shown)
        unknown = room is None and resume.session not in services.sessions.by_id
        if (
            unknown
            and not shown
            and resume.episode
            and services.lobby.may_have_ended(resume.episode)
        ):
            raise SearchFirstError(resume.episode, services.lobby.show_end)
        role = services.sessions.judge(resume, room, visitor)
        if room is not None:
            room.check_return(resume.session)
        known = services.sessions.by_id.get(resume.session)
        subject = "" if resume.anonymous else resume.participant
        self._take_slot(subject, known.counted_connection if known is not None else None)
        session = services.sessions.resume(resume, room, role)
        session.view = hello.view or session.view
        return session, True

    def _home_of(self, resume: ResumeGrant, *, shown: bool) -> JoinedRoom | None:
        """Return the room of a resume token; spectators may watch another node's episode here."""
        cluster, lobby = self._services.cluster, self._services.lobby
        if cluster is None or resume.seat:
            return lobby.home_of(resume.session, resume.episode)
        mirror = cluster.mirror_of(resume.session, resume.episode)
        if mirror is not None:
            return mirror
        try:
            return lobby.home_of(resume.session, resume.episode)
        except ElsewhereError:
            if shown:
                raise
            raise SearchFirstError(resume.episode, cluster.mirror) from None

    def _take_slot(self, subject: str, instead_of: CountedConnection | None = None) -> None:
        """Count the connection by the subject of its token from now on, if it has one."""
        counted = counted_as(self._connection.who, subject)
        self._services.connection_limiter.admit(self._connection, counted, instead_of)
        self._counted = counted
        self.peer.socket.share_turns(counted.turn_group)

    def _attach(self, session: Session) -> None:
        """Make this the session's connection, and close an earlier one."""
        old, session.peer = session.peer, self.peer
        if old is not None:
            session.earlier_bytes += old.received_bytes
        self.session = session
        self.peer.socket.accept_long_messages()
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
    """Return the error for a client with another protocol version."""
    older = "the server" if protocol > messages.PROTOCOL_VERSION else "your program"
    versions = f"the client has version {protocol}, the server {messages.PROTOCOL_VERSION}"
    return f"{versions}; {older} is older and must be updated"
