"""The server: accepts connections, goes on with what was left, and loses nothing when it stops."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import random
import ssl
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import Any

from websockets.asyncio.server import Server as SocketServer
from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as listen
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from robotouille.episode import Phase
from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol.codec import MAX_CLIENT_BYTES, SUBPROTOCOLS, codec_for
from robotouille_server.auth import (
    REVOKED_FILE,
    CodeGuessLimiter,
    ConnectionLimiter,
    CountedConnection,
    FileKeyring,
    Keyring,
    Revocations,
    Role,
    RoleGrant,
    Tokens,
    UsedTokens,
    Visitor,
    comes_from,
    origin_refusal,
    parse_networks,
    parse_origins,
    visitor,
)
from robotouille_server.conversation import Conversation, Services, ShutdownNotice
from robotouille_server.health import Alert, Health, alerts
from robotouille_server.rooms.lobby import Lobby
from robotouille_server.rooms.recordings import Folder, Storage
from robotouille_server.rooms.session import JoinedRoom, Session
from robotouille_server.rooms.sessions import Sessions
from robotouille_server.rooms.substitutes.bot_worker import BotWorker
from robotouille_server.rooms.substitutes.worker_process import ProcessBotWorker
from robotouille_server.runtime.audit_log import AuditLog
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.workers import WorkerSlot
from robotouille_server.transport import (
    MAX_HELD,
    MAX_SURPLUS_CONNECTIONS,
    Admission,
    Connection,
    Peer,
    PendingConnection,
    ServerTLS,
    cut,
)

__all__ = ["CannotListenError", "Server", "serve"]

ACCEPTED_AT_ONCE = 32
"""Connections after which what is there already has its turn."""
WAITING_TO_BE_ACCEPTED = 4096
CLOSE_SECONDS, ABORT_SECONDS = 5.0, 1.0
DRAIN_LOOK_SECONDS = 0.2


class CannotListenError(RobotouilleError):
    """The address is in use, or not ours."""


class Server:
    """One server process. Use `serve()`, which starts and stops it, and takes the same arguments.

    Raises:
        RobotouilleError: The keys, the list of revoked tokens or a setting cannot be used.
    """

    def __init__(
        self,
        settings: ServerSettings,
        *,
        randomness: random.Random | None = None,
        timestamp: Callable[[], str] | None = None,
        storage: Storage | None = None,
        wall: Callable[[], float] = time.time,
        worker: WorkerSlot | None = None,
        bot_worker: Callable[[], BotWorker] = ProcessBotWorker,
    ) -> None:
        self.settings = settings
        self.metrics = Metrics()
        self.wall = wall
        self._admission = Admission(
            self.metrics, settings.max_connections + MAX_SURPLUS_CONNECTIONS, settings.hello_seconds
        )
        self.storage: Storage | None = None
        if settings.record:
            self.storage = storage or Folder(settings.recordings)
        self.worker = worker or WorkerSlot()
        rng = randomness or random.SystemRandom()
        revoked = Revocations(_key_file(settings).with_name(REVOKED_FILE))
        self.tokens = Tokens(_keyring(settings), wall, revoked)
        self._used_tokens = UsedTokens(settings.state_folder / "used-tokens", wall)
        self.audit = AuditLog(settings.state_folder / self.worker.file_name("audit.log"), wall)
        folder = self.storage.path if isinstance(self.storage, Folder) else None
        self.health = Health(self.metrics, folder)
        self.sessions = Sessions(
            self.tokens,
            self._used_tokens,
            revoked,
            rng,
            settings.resume_hours * 3600,
            self.metrics,
            strict=settings.require_token,
            max_spectators=settings.max_spectators,
        )
        self.lobby = Lobby(
            settings,
            self.metrics,
            rng,
            timestamp or (lambda: datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")),
            wall,
            storage=self.storage,
            worker=self.worker,
            resume_token=self.sessions.resume_token,
            vacated=self.sessions.forget,
            sent_out=self.sessions.sent_out,
            bot_worker=bot_worker,
        )
        self._connection_limiter = ConnectionLimiter(settings.max_connections_per_address)
        self._notice: ShutdownNotice | None = None
        self.services = Services(
            settings=settings,
            metrics=self.metrics,
            lobby=self.lobby,
            sessions=self.sessions,
            tokens=self.tokens,
            used_tokens=self._used_tokens,
            connection_limiter=self._connection_limiter,
            code_guesses=CodeGuessLimiter(),
            loop_budget=self._admission.loop_budget,
            shutdown_notice=lambda: self._notice,
        )
        self._proxies = parse_networks(settings.trust_proxy, "--trust-proxy")
        self._metrics_from = parse_networks(settings.metrics_from, "--metrics-from")
        self._origins = parse_origins(settings.origins)
        self._sockets: list[SocketServer] = []
        self._tls: ServerTLS | None = None
        self._watching: asyncio.Task[None] | None = None
        self._open: dict[Connection, None] = {}  # In the order in which they came.
        self._accepted = 0
        self._stopping = False

    # Life

    async def start(self) -> None:
        """Go on with the episodes that were left, and listen.

        Raises:
            CannotListenError: The address cannot be had.
            RobotouilleError: The recordings folder or the TLS files cannot be used.
        """
        folder = self.settings.recordings
        try:
            if isinstance(self.storage, Folder):
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RobotouilleError(f"the recordings folder {folder}: {error.strerror}") from None
        if self.settings.tls_cert is not None or self.settings.tls_key is not None:
            self._tls = ServerTLS.from_settings(self.settings.tls_cert, self.settings.tls_key)
            self._watching = asyncio.create_task(self._tls.watch())
        self._used_tokens.forget_expired()
        self._admission.tls = self.tls
        self.lobby.recover()
        shared = self.worker.count > 1
        await self._listen(self.settings.port, shared=shared)
        if shared:
            await self._listen(self.worker.first_port + self.worker.index, shared=False)
        self.lobby.opened()
        get_logger().info("listening", url=self.url)

    async def _listen(self, port: int, *, shared: bool) -> None:
        try:
            socket = await listen(
                self._serve_connection,
                self.settings.host,
                port,
                create_connection=self._accept,  # type: ignore[arg-type]
                subprotocols=[Subprotocol(name) for name in SUBPROTOCOLS],
                select_subprotocol=_select_subprotocol,
                process_request=self._http,
                compression=None,
                max_size=2 * MAX_CLIENT_BYTES,
                open_timeout=self.settings.hello_seconds,
                ping_interval=20,
                ping_timeout=20,
                close_timeout=2,
                backlog=ACCEPTED_AT_ONCE,
                write_limit=2 * MAX_HELD,
                reuse_port=shared or None,
            )
        except OSError as error:
            where = f"{self.settings.host}:{port}"
            other = "; take another with --port" if error.errno == errno.EADDRINUSE else ""
            message = f"cannot listen on {where}: {error.strerror}{other}"
            raise CannotListenError(message) from None
        for listening in socket.sockets:
            with listening.dup() as same:  # asyncio has one number for both.
                same.listen(WAITING_TO_BE_ACCEPTED)
        self._sockets.append(socket)

    @property
    def port(self) -> int:
        """The port in use."""
        if not self._sockets:
            return self.settings.port
        port: int = next(iter(self._sockets[0].sockets)).getsockname()[1]
        return port

    @property
    def url(self) -> str:
        """The address for clients; on this machine, where it listens on all addresses."""
        host = "127.0.0.1" if self.settings.host == "0.0.0.0" else self.settings.host  # noqa: S104
        return self._url(host)

    @property
    def public_url(self) -> str:
        """The same as people are told it: with TLS by a name that the certificate has."""
        name = self._tls.name if self._tls is not None else ""
        return self._url(name) if name else self.url

    def _url(self, host: str) -> str:
        scheme = "wss" if self._tls is not None else "ws"
        return f"{scheme}://{f'[{host}]' if ':' in host else host}:{self.port}"

    @property
    def open_count(self) -> int:
        """Connections and rooms that there are."""
        return len(self._open) + len(self.lobby.rooms)

    @property
    def closed_count(self) -> int:
        """Connections, welcome or not, and rooms that there have been and are not any more."""
        return self._accepted - len(self._open) + self.lobby.dropped

    async def drain(self, seconds: float) -> None:
        """Open no more episodes and accept nobody new, until all are over or time is up.

        An episode that somebody's connection is lost from is left to the next process at once:
        only there can they come back.

        Args:
            seconds: How long running episodes have to finish.
        """
        self.lobby.drain()
        for socket in self._sockets:
            socket.close(close_connections=False)
        for room in list(self.lobby.rooms.values()):
            if room.episode.phase is Phase.WAITING:
                self._hand_over(room)
        for session in list(self.sessions.by_id.values()):
            idle = session.room is None or not session.room.episode.in_progress
            if idle and session.peer is not None:
                session.peer.close("server/restart", "restart", retry=True, status=1012)
        loop = asyncio.get_running_loop()
        deadline = loop.time() + seconds
        while self._playing() and loop.time() < deadline:  # noqa: ASYNC110
            await asyncio.sleep(DRAIN_LOOK_SECONDS)

    def _playing(self) -> bool:
        return any(room.episode.in_progress for room in self.lobby.rooms.values())

    async def stop(self, reason: str = "the server shuts down", *, hand_over: bool = False) -> None:
        """End all episodes, or leave them to the next process; tell all clients. The first call
        counts.

        Args:
            reason: What clients are told.
            hand_over: Leave them to the next process; they end all the same where nothing is
                recorded.
        """
        if self._stopping:
            return
        self._stopping = True
        hand_over = hand_over and self.storage is not None
        self._notice = ShutdownNotice(reason, hand_over)
        self.lobby.drain()
        for room in list(self.lobby.rooms.values()):
            if hand_over and room.episode.phase is not Phase.ENDED:
                self.lobby.suspend(room.id)
                continue
            try:
                room.abort(reason)
            except Exception:
                get_logger().exception("the episode failed", episode=room.id)
        for session in list(self.sessions.by_id.values()):
            if session.peer is not None:
                self._notice.send(session.peer)
        self.sessions.stop()
        await self._close_sockets(reason)
        if self._watching is not None:
            self._watching.cancel()
        await self.lobby.closed()
        self.lobby.stop()
        if self._sockets:  # Else it has not begun, and whoever started it says why.
            get_logger().info("stopped", reason=reason)

    async def _close_sockets(self, reason: str) -> None:
        for socket in self._sockets:
            socket.close(close_connections=True, code=1001, reason=cut(reason))
        if self._sockets:
            self._admission.close()
        for connection in list(self._open):  # After a drain the line above does nothing.
            connection.say_goodbye(1001, reason)
        for seconds in (CLOSE_SECONDS, ABORT_SECONDS):
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(seconds):
                    for socket in self._sockets:
                        await socket.wait_closed()
            for connection in self._open:
                connection.transport.abort()

    def announce(self, text: str) -> None:
        """Say something to everybody in every episode."""
        for room in list(self.lobby.rooms.values()):
            room.announce(text)

    @property
    def tls(self) -> ssl.SSLContext | None:
        """What the sockets are encrypted with."""
        return self._tls.context if self._tls is not None else None

    def authorize(self, token: str) -> RoleGrant:
        """What an operator's token grants.

        Raises:
            ProtocolError: `auth/role`, `auth/invalid`, `auth/expired` or `auth/revoked`, unless it
                is one.
        """
        grant = self.tokens.check_role(token)
        if grant.role is not Role.OPERATOR:
            raise ProtocolError("auth/role", "this takes a token with the role operator", "token")
        return grant

    def sample(self, now: float) -> None:
        """Look at what alerts are about; cheap, as it is done anew only now and then."""
        self.health.sample(now, self.sessions.by_id.values())

    def alerts(self) -> list[Alert]:
        """What the operator must look after, as it was when it was sampled."""
        found = alerts(self.health)
        if self.audit.problem:
            found.insert(0, Alert("audit", self.audit.problem, "critical"))
        return found

    # HTTP on the same port

    def _http(self, connection: ServerConnection, request: Request) -> Response | None:
        path = request.path.partition("?")[0]
        if path == "/healthz":
            return connection.respond(HTTPStatus.OK, "ok\n")
        if path == "/metrics":
            return self._metrics_page(connection, request)
        if self._stopping or len(self._open) >= self.settings.max_connections:
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "the server is full\n")
        if "websocket" not in ",".join(request.headers.get_all("Upgrade")).lower():
            text = "This is a Robotouille server. Play: robotouille-client --url ws://…\n"
            return connection.respond(HTTPStatus.UPGRADE_REQUIRED, text)
        refusal = origin_refusal(request.headers, self._origins)
        if refusal is not None:
            return connection.respond(HTTPStatus.FORBIDDEN, refusal)
        return None

    def _metrics_page(self, connection: ServerConnection, request: Request) -> Response:
        peer, headers = connection.remote_address, request.headers
        who = self._visitor(connection, request)
        if not who.local and not comes_from(peer, headers, self._metrics_from):
            text = "metrics are for programs on the server's own machine, and --metrics-from\n"
            return connection.respond(HTTPStatus.FORBIDDEN, text)
        self.sample(connection.loop.time())
        response = connection.respond(HTTPStatus.OK, self.metrics.page().decode())
        del response.headers["Content-Type"]
        response.headers["Content-Type"] = "text/plain; version=0.0.4; charset=utf-8"
        return response

    def _visitor(self, connection: ServerConnection, request: Request) -> Visitor:
        return visitor(connection.remote_address, request.headers, self._proxies)

    # Connections

    def _accept(self, *arguments: Any, **options: Any) -> PendingConnection:
        self._accepted += 1
        return PendingConnection(*arguments, admission=self._admission, **options)

    async def _serve_connection(self, socket: ServerConnection) -> None:
        if not isinstance(socket, Connection) or socket.request is None:
            raise TypeError("not a connection of this server")
        who = self._visitor(socket, socket.request)
        codec = codec_for(socket.subprotocol)
        peer = Peer(socket, codec, self.metrics, self.settings.stall_seconds)
        counted = CountedConnection(who, partial(self._displace, peer))
        conversation = Conversation(self.services, peer, counted)
        self._connection_limiter.arrive(counted)
        self._open[socket] = None
        self.metrics.connections.set(len(self._open))
        try:
            socket.listen(conversation.receive)
            await socket.wait_closed()
        finally:
            self._open.pop(socket, None)
            self.metrics.connections.set(len(self._open))
            self._connection_limiter.release(counted)
            conversation.close()
            session = conversation.session
            if session is not None and session.peer is peer:
                self._disconnected(session)

    def _displace(self, peer: Peer) -> None:
        """Somebody newer needs the slot of a connection that has not said hello."""
        self.metrics.dropped.labels("displaced").inc()
        text = "too many connections from your address have said no hello"
        peer.close("rate/connections", text, retry=True, status=1013)

    def _disconnected(self, session: Session) -> None:
        """A connection is gone: its session is kept for a while, and nothing else of it."""
        session.disconnected()
        if self._stopping:
            return
        room, draining = session.room, self.lobby.draining
        if draining and session.players and room is not None and self._hand_over(room):
            return
        self.sessions.disconnected(session)

    def _hand_over(self, room: JoinedRoom) -> bool:
        """Leave one episode to the next process, while this one drains, if it is not over."""
        if self.storage is None or room.episode.phase is Phase.ENDED:
            return False
        for member in self.lobby.suspend(room.id):
            if member.peer is not None:
                member.peer.close("server/restart", "handed over", retry=True, status=1012)
        return True


def _keyring(settings: ServerSettings) -> Keyring:
    if settings.signing_keys is not None:
        return Keyring.parse(settings.signing_keys.get_secret_value())
    return FileKeyring(_key_file(settings))


def _key_file(settings: ServerSettings) -> Path:
    return settings.keys or settings.state_folder / "keys.json"


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
    storage: Storage | None = None,
    wall: Callable[[], float] = time.time,
    worker: WorkerSlot | None = None,
    bot_worker: Callable[[], BotWorker] = ProcessBotWorker,
) -> AsyncIterator[Server]:
    """A running server: `async with serve(ServerSettings(port=0)) as server: …`.

    Where the context is left its episodes end, unless `Server.stop` was called before; where an
    exception leaves it they are left to the next process.

    Args:
        randomness: For ids and codes; the operating system's if None.
        timestamp: The time that recordings are named by, as `20250131T120000Z`.
        storage: Where recordings are kept; the settings' folder if None.
        wall: Seconds since 1970, for tokens, the audit log and recordings.
        worker: Which of several processes this is; the only one if None.
        bot_worker: Makes the worker in which substitute bots decide, once there is one: a process
            of its own.

    Raises:
        RobotouilleError: The server cannot start: the address cannot be had, or the keys, the
            folders, the TLS files or a setting cannot be used.
    """
    server = Server(
        settings,
        randomness=randomness,
        timestamp=timestamp,
        storage=storage,
        wall=wall,
        worker=worker,
        bot_worker=bot_worker,
    )
    try:
        await server.start()
        yield server
    except BaseException:
        # Whatever went wrong is not the players' fault.
        await server.stop("the server failed", hand_over=True)
        raise
    finally:
        await server.stop()
