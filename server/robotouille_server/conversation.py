"""One connection's side of the protocol: hello, then requests."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.release import RELEASE
from robotouille_server.access import Visitor
from robotouille_server.limits import Budget
from robotouille_server.logs import get_logger
from robotouille_server.peer import Peer
from robotouille_server.roles import check_join, check_permission
from robotouille_server.room import Room
from robotouille_server.session import Session
from robotouille_server.workers import ElsewhereError

if TYPE_CHECKING:
    from robotouille_server.app import Server

__all__ = ["Conversation"]

COSTS: dict[type[messages.Message], float] = {messages.Create: 10, messages.ListEpisodes: 3}
"""What a message takes of a connection's budget, where that is not one."""
MAX_REFUSED = 200
"""Messages over the limit, in about a minute, after which a connection is closed."""


class Conversation:
    """Takes the messages of one connection, as they come, and answers each."""

    __slots__ = (
        "_budget",
        "_loop",
        "_patience",
        "_server",
        "_silence",
        "_visitor",
        "peer",
        "session",
    )

    def __init__(self, server: Server, peer: Peer, visitor: Visitor) -> None:
        self.session: Session | None = None
        self.peer = peer
        self._server = server
        self._visitor = visitor
        self._loop = asyncio.get_running_loop()
        self._budget = Budget(server.settings.messages_per_second, self._loop.time())
        self._patience = Budget(MAX_REFUSED / 60, self._loop.time(), MAX_REFUSED)
        self._silence: asyncio.TimerHandle | None = self._loop.call_later(
            server.settings.hello_seconds, self._too_silent
        )

    def close(self) -> None:
        """The connection is gone."""
        if self._silence is not None:
            self._silence.cancel()

    def _too_silent(self) -> None:
        self._server.metrics.dropped.labels("silent").inc()
        self.peer.part("auth/silent", "no hello in time", retry=True)

    def receive(self, payload: bytes | str) -> None:
        """Take one message; whatever is wrong with it is answered."""
        peer, server, session = self.peer, self._server, self.session
        if not peer.open or (session is not None and session.peer is not peer):
            return
        if server.farewell is not None:
            server.farewell.say(peer)
            return
        server.metrics.received += 1
        peer.received += 1
        peer.received_bytes += len(payload)
        message = ref = None
        try:
            message = peer.codec.decode_client(payload)
            ref = None if type(message) is messages.Act else getattr(message, "ref", None)
            self._heed(message)
        except ProtocolError as error:
            if message is not None or self._may_err():
                self._answer_error(error, ref)
        except Exception:
            get_logger().exception("a message failed")
            failure = ProtocolError("server/internal", "the server failed to handle this")
            self._answer_error(failure, ref)
        peer.throttle()

    def _may_err(self) -> bool:
        """Whether a message that cannot be read is answered; with too many of them it is over."""
        now = self._loop.time()
        if self._budget.take(now) or self._patience.take(now):
            return True
        self._end_flood()
        return False

    def _end_flood(self) -> None:
        self._server.metrics.dropped.labels("flood").inc()
        self.peer.part("rate/limited", "far too many messages")

    def _heed(self, message: messages.ClientMessage) -> None:
        if not self._budget.take(self._loop.time(), COSTS.get(type(message), 1)):
            self._refuse(message)
        elif self.session is None:
            self._greet(message)
        else:
            check_permission(self.session.role, message)
            HANDLERS[type(message)](self, self.session, message)

    def _refuse(self, message: messages.ClientMessage) -> None:
        """Too many messages: an action is rejected, anything else an error, a flood the end."""
        if not self._patience.take(self._loop.time()):
            self._end_flood()
            return
        code = "rate/limited"
        reason = f"more than {self._server.settings.messages_per_second:g} messages a second"
        if not isinstance(message, messages.Act):
            raise ProtocolError(code, reason)
        self._server.metrics.errors.labels(code).inc()
        rejected = messages.Rejected(
            seq=message.seq, step=message.basis or 0, action="", reasons=[reason], code=code
        )
        self.peer.send(rejected)

    def _answer_error(self, error: ProtocolError, ref: int | None) -> None:
        self._server.metrics.errors.labels(error.code).inc()
        self.peer.send(
            messages.Error(
                ref=ref if ref is not None else error.ref,
                code=error.code,
                message=error.message[:1000],
                field=error.field,
            )
        )

    # Hello

    def _greet(self, message: messages.ClientMessage) -> None:
        if not isinstance(message, messages.Hello):
            raise ProtocolError("protocol/hello", "say hello first", "type")
        if message.protocol != messages.PROTOCOL_VERSION:
            text = f"version {message.protocol}; this server speaks {messages.PROTOCOL_VERSION}"
            raise ProtocolError("protocol/version", text, "protocol")
        try:
            session, resumed = self._session(message)
        except ElsewhereError as error:
            self.peer.send(error.moved(message.ref))
            return
        if self._silence is not None:
            self._silence.cancel()
        self._attach(session)
        server = self._server
        room = session.room
        welcome = messages.Welcome(
            ref=message.ref,
            protocol=messages.PROTOCOL_VERSION,
            server=RELEASE,
            session=session.id,
            resume=server.sessions.resume_token(session),
            resumed=resumed,
            role=session.role.value,
            grace=room.episode.rules.grace if room is not None else server.settings.grace,
        )
        self.peer.send(welcome)
        if resumed:
            server.metrics.resumed.inc()
            if room is not None:
                room.connection_back(session, message.seen)
            elif message.seen is not None:
                reason = "you are no longer in this episode"
                self.peer.send(messages.Left(episode=message.seen.episode, reason=reason))

    def _session(self, hello: messages.Hello) -> tuple[Session, bool]:
        """A newcomer's session, or that of a connection which was lost."""
        server = self._server
        if hello.resume is None:
            role, grant = server.sessions.role_of(
                hello, self._visitor, strict=server.settings.require_token
            )
            return server.sessions.open(hello, role, grant), False
        resume = server.tokens.check_resume(hello.resume)
        room = server.lobby.home_of(resume.session, resume.episode)
        session = server.sessions.resume(resume, room)
        session.view = hello.view or session.view
        return session, True

    def _attach(self, session: Session) -> None:
        """This is the session's connection from now on; an earlier one is told so."""
        old, session.peer = session.peer, self.peer
        if old is not None:
            session.earlier_bytes += old.received_bytes
        self.session = session
        session.visitor = self._visitor
        self._server.expect(session)
        if self._server.settings.record_addresses:
            address = self._visitor.address
            get_logger().info("participant connected", session=session.id, address=address)
        if old is not None:
            old.part("session/elsewhere", "the connection was resumed elsewhere")

    # Requests

    def _hello_again(self, session: Session, message: messages.Hello) -> None:
        raise ProtocolError("protocol/hello", "you have said hello already", "type")

    def _list(self, session: Session, message: messages.ListEpisodes) -> None:
        infos = self._server.lobby.infos()
        self.peer.send(messages.Episodes(ref=message.ref, episodes=infos))

    def _create(self, session: Session, message: messages.Create) -> None:
        owner = session.participant if session.participant != session.id else ""
        room = self._server.lobby.create(message, owner=owner)
        created = messages.Created(ref=message.ref, episode=room.id, code=room.code)
        self.peer.send(created)

    def _join(self, session: Session, message: messages.Join) -> None:
        if session.room is not None:
            where = session.room.code
            raise ProtocolError("episode/joined", f"you are in {where}; leave it first", "type")
        try:
            room = self._find(message.episode)
        except ElsewhereError as error:
            self.peer.send(error.moved(message.ref))
            return
        seat = check_join(
            message,
            only=session.only_episode,
            seat=session.only_seat,
            episode=room.id,
            code=room.code,
        )
        request = message.model_copy(update={"seat": seat})
        room.enter(session, request, self._server.settings.max_spectators)

    def _find(self, name: str) -> Room:
        """The room of a code; whoever guesses codes has to wait soon."""
        now, codes = self._loop.time(), self._server.wrong_codes
        codes.check(self._visitor, now)
        try:
            return self._server.lobby.find(name)
        except ProtocolError as error:
            if error.code == "episode/unknown":
                codes.wrong(self._visitor, now)
            raise

    def _leave(self, session: Session, message: messages.Leave) -> None:
        room = self._room(session)
        room.leave(session)
        self.peer.send(messages.Left(ref=message.ref, episode=room.id))

    def _act(self, session: Session, message: messages.Act) -> None:
        if session.room is not None:
            session.room.act(session, message)
            return
        rejected = messages.Rejected(
            seq=message.seq, step=0, action="", reasons=["join an episode first"],
            code="episode/none",
        )  # fmt: skip
        self.peer.send(rejected)

    def _say(self, session: Session, message: messages.Say) -> None:
        self._room(session).say(session, message.text)

    def _resync(self, session: Session, message: messages.Resync) -> None:
        self._room(session).send_picture(session)

    def _room(self, session: Session) -> Room:
        if session.room is None:
            raise ProtocolError("episode/none", "join an episode first", "type")
        return session.room


HANDLERS: dict[type[messages.Message], Callable[[Conversation, Session, Any], None]] = {
    messages.ListEpisodes: Conversation._list,
    messages.Create: Conversation._create,
    messages.Join: Conversation._join,
    messages.Leave: Conversation._leave,
    messages.Act: Conversation._act,
    messages.Say: Conversation._say,
    messages.Resync: Conversation._resync,
    messages.Hello: Conversation._hello_again,
}
