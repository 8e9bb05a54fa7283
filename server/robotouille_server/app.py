"""The server: accepts connections, speaks the protocol with them, and stops cleanly."""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from http import HTTPStatus
from importlib.metadata import version

from websockets.asyncio.server import Server as SocketServer
from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as listen
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol import messages
from robotouille.protocol.codec import MAX_CLIENT_BYTES, SUBPROTOCOLS, codec_for
from robotouille_server.lobby import Lobby
from robotouille_server.logs import get_logger
from robotouille_server.metrics import Metrics
from robotouille_server.peer import Peer
from robotouille_server.room import Room
from robotouille_server.session import Session
from robotouille_server.settings import ServerSettings

__all__ = ["CannotListenError", "Server", "serve"]


class CannotListenError(RobotouilleError):
    """The address is in use, or not ours."""


class Budget:
    """How many messages a connection may still send: a bucket that refills with time."""

    def __init__(self, per_second: float, now: float) -> None:
        self._rate = per_second
        self._left = 2 * per_second
        self._at = now

    def take(self, now: float, cost: float = 1) -> bool:
        self._left = min(2 * self._rate, self._left + (now - self._at) * self._rate)
        self._at = now
        if self._left < cost:
            return False
        self._left -= cost
        return True


COSTS: dict[type[messages.Message], float] = {messages.Create: 10, messages.ListEpisodes: 3}
"""What a message takes of a connection's budget, where that is not one."""


class Server:
    """One server process. Use `serve()`, which starts and stops it."""

    def __init__(
        self,
        settings: ServerSettings,
        *,
        randomness: random.Random | None = None,
        timestamp: Callable[[], str] | None = None,
    ) -> None:
        self.settings = settings
        self.metrics = Metrics()
        self._random = randomness or random.SystemRandom()
        stamp = timestamp or (lambda: datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ"))
        self.lobby = Lobby(settings, self.metrics, self._random, stamp)
        self._sessions: dict[str, Session] = {}
        self._socket: SocketServer | None = None
        self._connections = 0
        self._stopping = False
        self._handlers: dict[
            type[messages.Message], Callable[[Session, messages.ClientMessage], None]
        ] = {
            messages.ListEpisodes: self._list,
            messages.Create: self._create,
            messages.Join: self._join,
            messages.Leave: self._leave,
            messages.Act: self._act,
            messages.Say: self._say,
            messages.Resync: self._resync,
            messages.Hello: self._hello_again,
        }

    # Life

    async def start(self) -> None:
        """Begin to listen; CannotListenError if the address cannot be had."""
        folder = self.settings.recordings
        try:
            if self.settings.record:
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RobotouilleError(f"the recordings folder {folder}: {error.strerror}") from None
        try:
            self._socket = await self._listen()
        except OSError as error:
            where = f"{self.settings.host}:{self.settings.port}"
            raise CannotListenError(f"cannot listen on {where}: {error.strerror}") from None
        get_logger().info("listening", url=self.url)

    async def _listen(self) -> SocketServer:
        return await listen(
            self._serve_connection,
            self.settings.host,
            self.settings.port,
            subprotocols=[Subprotocol(name) for name in SUBPROTOCOLS],
            select_subprotocol=_select_subprotocol,
            process_request=self._http,
            compression=None,
            max_size=2 * MAX_CLIENT_BYTES,
            max_queue=16,
            open_timeout=self.settings.hello_seconds,
            ping_interval=20,
            ping_timeout=20,
            close_timeout=2,
        )

    @property
    def port(self) -> int:
        """The port in use."""
        if self._socket is None:
            return self.settings.port
        port: int = next(iter(self._socket.sockets)).getsockname()[1]
        return port

    @property
    def url(self) -> str:
        host = "127.0.0.1" if self.settings.host == "0.0.0.0" else self.settings.host  # noqa: S104
        return f"ws://{f'[{host}]' if ':' in host else host}:{self.port}"

    async def stop(self, reason: str = "the server shuts down") -> None:
        """End all episodes, tell all clients, close all recordings."""
        self._stopping = True
        for room in list(self.lobby.rooms.values()):
            try:
                room.abort(reason)
            except Exception:
                get_logger().exception("the episode failed", episode=room.id)
        for session in list(self._sessions.values()):
            session.cancel_expiry()
            if session.peer is not None:
                session.peer.send(messages.Bye(reason=reason))
        if self._socket is not None:
            self._socket.close(close_connections=True, code=1001, reason=reason)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._socket.wait_closed(), timeout=5)
            for connection in list(self._socket.connections):
                connection.transport.abort()
        get_logger().info("stopped", reason=reason)

    # HTTP on the same port

    def _http(self, connection: ServerConnection, request: Request) -> Response | None:
        path = request.path.partition("?")[0]
        if path == "/healthz":
            status = HTTPStatus.SERVICE_UNAVAILABLE if self._stopping else HTTPStatus.OK
            return connection.respond(status, "stopping\n" if self._stopping else "ok\n")
        if path == "/metrics":
            response = connection.respond(HTTPStatus.OK, self.metrics.page().decode())
            del response.headers["Content-Type"]
            response.headers["Content-Type"] = "text/plain; version=0.0.4; charset=utf-8"
            return response
        if self._stopping or self._connections >= self.settings.max_connections:
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "the server is full\n")
        if "websocket" not in request.headers.get("Upgrade", "").lower():
            text = "This is a Robotouille server. Play: robotouille-client --url ws://…\n"
            return connection.respond(HTTPStatus.UPGRADE_REQUIRED, text)
        return None

    # Connections

    async def _serve_connection(self, socket: ServerConnection) -> None:
        peer = Peer(
            socket, codec_for(socket.subprotocol), self.metrics, self.settings.stall_seconds
        )
        self._connections += 1
        self.metrics.connections.set(self._connections)
        session: Session | None = None
        try:
            session = await self._greet(peer)
            if session is not None:
                await self._converse(session, peer)
        except ConnectionClosed:
            get_logger().debug("connection closed", peer=str(socket.remote_address))
        finally:
            self._connections -= 1
            self.metrics.connections.set(self._connections)
            if session is not None and session.peer is peer:
                self._lost(session)

    async def _greet(self, peer: Peer) -> Session | None:
        """Wait for `hello`; a client that says nothing in time is dropped."""
        try:
            async with asyncio.timeout(self.settings.hello_seconds):
                while True:
                    payload = await peer.socket.recv()
                    self.metrics.received.inc()
                    try:
                        hello = peer.codec.decode_client(payload)
                        if not isinstance(hello, messages.Hello):
                            raise ProtocolError("protocol/hello", "say hello first", "type")
                        return self._open_session(peer, hello)
                    except ProtocolError as error:
                        self._answer_error(peer, error, None)
        except TimeoutError:
            self.metrics.dropped.labels("silent").inc()
            peer.send(messages.Bye(reason="no hello in time"))
            await peer.socket.close(1008, "no hello in time")
            return None

    def _open_session(self, peer: Peer, hello: messages.Hello) -> Session:
        if hello.protocol != messages.PROTOCOL_VERSION:
            message = f"version {hello.protocol}; this server speaks {messages.PROTOCOL_VERSION}"
            raise ProtocolError("protocol/version", message, "protocol")
        session = self._resumed(hello)
        resumed = session is not None
        if session is None:
            session = Session(self._token(64), self._token(128), hello.name, hello.kind)
            self._sessions[session.token] = session
        elif session.peer is not None:
            old, session.peer = session.peer, None
            old.send(messages.Bye(reason="the connection was resumed elsewhere"))
            old.part("resumed elsewhere")
        session.cancel_expiry()
        session.peer = peer
        welcome = messages.Welcome(
            ref=hello.ref,
            protocol=messages.PROTOCOL_VERSION,
            server=f"robotouille {version('robotouille')}",
            session=session.id,
            resume=session.token,
            resumed=resumed,
            grace=self.settings.grace,
        )
        peer.send(welcome)
        if resumed and session.room is not None:
            session.room.welcome(session, None)
            session.room.connection_back(session)
        return session

    def _resumed(self, hello: messages.Hello) -> Session | None:
        if hello.resume is None:
            return None
        session = self._sessions.get(hello.resume)
        if session is None:
            message = "this connection cannot be resumed any more; say hello without 'resume'"
            raise ProtocolError("auth/expired", message, "resume")
        return session

    def _token(self, bits: int) -> str:
        return f"{self._random.getrandbits(bits):0{bits // 4}x}"

    def _lost(self, session: Session) -> None:
        session.peer = None
        if self._stopping:
            return
        if session.room is not None:
            session.room.connection_lost(session)
        loop = asyncio.get_running_loop()
        grace = self.settings.grace if session.room is not None else 0
        session.expiry = loop.call_later(grace, self._expire, session)

    def _expire(self, session: Session) -> None:
        self._sessions.pop(session.token, None)
        if session.room is not None:
            session.room.leave(session)

    async def _converse(self, session: Session, peer: Peer) -> None:
        loop = asyncio.get_running_loop()
        budget = Budget(self.settings.messages_per_second, loop.time())
        async for payload in peer.socket:
            self.metrics.received.inc()
            ref = None
            try:
                message = peer.codec.decode_client(payload)
                ref = getattr(message, "ref", None)
                allowed = budget.take(loop.time(), COSTS.get(type(message), 1))
                if session.peer is not peer:
                    return
                if allowed:
                    self._handlers[type(message)](session, message)
                else:
                    self._refuse(peer, message)
            except ProtocolError as error:
                self._answer_error(peer, error, ref)
            except Exception:
                get_logger().exception("a message failed", session=session.id)
                failure = ProtocolError("server/internal", "the server failed to handle this")
                self._answer_error(peer, failure, ref)
            if not await peer.drained():
                return

    def _refuse(self, peer: Peer, message: messages.ClientMessage) -> None:
        """Too many messages: an action is rejected, anything else an error."""
        limit = f"{self.settings.messages_per_second:g}"
        error = ProtocolError("rate/limited", f"more than {limit} messages a second")
        if not isinstance(message, messages.Act):
            raise error
        self.metrics.errors.labels(error.code).inc()
        rejected = messages.Rejected(
            seq=message.seq, step=message.basis or 0, action="", reasons=[error.message],
            code=error.code,
        )  # fmt: skip
        peer.send(rejected)

    def _answer_error(self, peer: Peer, error: ProtocolError, ref: int | None) -> None:
        self.metrics.errors.labels(error.code).inc()
        peer.send(
            messages.Error(
                ref=ref or error.ref, code=error.code, message=error.message, field=error.field
            )
        )

    # Messages

    def _hello_again(self, session: Session, message: messages.ClientMessage) -> None:
        raise ProtocolError("protocol/hello", "you have said hello already", "type")

    def _list(self, session: Session, message: messages.ClientMessage) -> None:
        ref = message.ref if isinstance(message, messages.ListEpisodes) else None
        infos = self.lobby.infos()
        self._reply(session, messages.Episodes(ref=ref, episodes=infos))

    def _create(self, session: Session, message: messages.ClientMessage) -> None:
        if isinstance(message, messages.Create):
            room = self.lobby.create(message, asyncio.get_running_loop().time())
            self._reply(session, messages.Created(ref=message.ref, episode=room.id, code=room.code))

    def _join(self, session: Session, message: messages.ClientMessage) -> None:
        if isinstance(message, messages.Join):
            if session.room is not None:
                where = session.room.code
                raise ProtocolError("episode/joined", f"you are in {where}; leave it first", "type")
            room = self.lobby.find(message.episode)
            room.enter(session, message, self.settings.max_spectators)

    def _leave(self, session: Session, message: messages.ClientMessage) -> None:
        room = self._room(session)
        room.leave(session)
        ref = message.ref if isinstance(message, messages.Leave) else None
        self._reply(session, messages.Left(ref=ref, episode=room.id))

    def _act(self, session: Session, message: messages.ClientMessage) -> None:
        if not isinstance(message, messages.Act):
            return
        if session.room is not None:
            session.room.act(session, message)
        else:
            reasons = ["join an episode first"]
            self._reply(
                session,
                messages.Rejected(
                    seq=message.seq, step=0, action="", reasons=reasons, code="episode/none"
                ),
            )

    def _say(self, session: Session, message: messages.ClientMessage) -> None:
        if isinstance(message, messages.Say):
            self._room(session).say(session, message.text)

    def _resync(self, session: Session, message: messages.ClientMessage) -> None:
        self._room(session).send_picture(session)

    def _room(self, session: Session) -> Room:
        if session.room is None:
            raise ProtocolError("episode/none", "join an episode first", "type")
        return session.room

    def _reply(self, session: Session, message: messages.Message) -> None:
        if session.peer is not None:
            session.peer.send(message)


def _select_subprotocol(
    connection: ServerConnection, offered: Sequence[Subprotocol]
) -> Subprotocol | None:
    """The first subprotocol that both sides know; none is JSON for clients written by hand."""
    return next((name for name in offered if name in SUBPROTOCOLS), None)


@asynccontextmanager
async def serve(
    settings: ServerSettings,
    *,
    randomness: random.Random | None = None,
    timestamp: Callable[[], str] | None = None,
) -> AsyncIterator[Server]:
    """A running server: `async with serve(ServerSettings(port=0)) as server: …`."""
    server = Server(settings, randomness=randomness, timestamp=timestamp)
    await server.start()
    try:
        yield server
    finally:
        await server.stop()
