"""Server process: starts and stops the listener, the lobby and everything around them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace

from robotouille.episode import Phase
from robotouille.errors import ProtocolError, RobotouilleError
from robotouille_server.auth import (
    CodeGuessLimiter,
    ConnectionLimiter,
    Credentials,
    Role,
    RoleGrant,
)
from robotouille_server.health import Alert, Health, alerts
from robotouille_server.listener import CannotListenError, Connections, HttpPages, Listener
from robotouille_server.requests import Services, Shutdown, ShutdownNotice
from robotouille_server.rooms.lobby import Lobby
from robotouille_server.rooms.participants.session import JoinedRoom, Session
from robotouille_server.rooms.participants.sessions import Sessions
from robotouille_server.rooms.recording.storage import Folder
from robotouille_server.rooms.room_factory import Surroundings
from robotouille_server.runtime.logs import AuditLog, get_logger
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.transport import (
    MAX_SURPLUS_CONNECTIONS,
    SILENT_FACTOR,
    Admission,
    Newcomers,
    ServerTLS,
)

__all__ = ["CannotListenError", "Server", "Surroundings", "serve"]

DRAIN_CHECK_SECONDS = 0.2


class Server:
    """One server process. Use `serve()`, which starts and stops it.

    Attributes:
        settle: Waits until everything is recorded; set by a cluster.
        ready: Returns whether clients should come to this process; set by a cluster.

    Raises:
        RobotouilleError: The keys, the list of revoked tokens or a setting cannot be used.
    """

    def __init__(self, settings: ServerSettings, around: Surroundings | None = None) -> None:
        around = _with_storage(settings, around or Surroundings())
        self.settings = settings
        self.metrics = Metrics()
        self.wall = around.wall
        self.worker = around.worker
        self.storage = around.storage
        self.audit = AuditLog(
            settings.state_folder / self.worker.file_name("audit.log"), around.wall
        )
        folder = self.storage.path if isinstance(self.storage, Folder) else None
        reserve = settings.reserved_bytes if around.cluster is None else 0
        self.health = Health(self.metrics, folder, reserve=reserve)
        credentials = Credentials.load(settings, around.wall)
        self.tokens = credentials.tokens
        self._used_tokens = credentials.used
        self.sessions = Sessions(settings, self.metrics, credentials, around.randomness)
        limit = settings.max_connections + MAX_SURPLUS_CONNECTIONS
        pages = HttpPages(settings, self._full, self._is_ready, self._metrics_page, self.worker)
        per_address = settings.max_connections_per_address
        newcomers = Newcomers(per_address, SILENT_FACTOR * per_address, pages.newcomer_group)
        self.admission = Admission(
            self.metrics, limit, settings.hello_seconds, newcomers, pages.newcomer_turn_group
        )
        loop_budget = self.admission.loop_budget
        self.lobby = Lobby(settings, self.metrics, self.sessions, loop_budget, around)
        self.shutdown = Shutdown()
        self.settle: Callable[[], Awaitable[None]] = _nothing_to_settle
        self.ready: Callable[[], bool] = _always
        self.services = Services(
            settings=settings,
            metrics=self.metrics,
            lobby=self.lobby,
            sessions=self.sessions,
            tokens=credentials.tokens,
            used_tokens=credentials.used,
            connection_limiter=ConnectionLimiter(per_address),
            code_guesses=CodeGuessLimiter(),
            loop_budget=loop_budget,
            shutdown=self.shutdown,
            worker=self.worker,
        )
        self.connections = Connections(self.services, self.admission, pages, self._disconnected)
        self.listener = Listener(settings, self.worker, self.connections, pages, self.admission)

    def _full(self) -> bool:
        too_many = len(self.connections.open) >= self.settings.max_connections
        return self.shutdown.begun or too_many

    def _is_ready(self) -> bool:
        return self.ready() and not self.lobby.draining and not self._full()

    def _metrics_page(self, now: float) -> bytes:
        self.sample(now)
        return self.metrics.recent_page(now)

    # Life cycle

    async def start(self) -> None:
        """Continue the episodes that another process has left, and listen.

        Raises:
            CannotListenError: The address is not available.
            RobotouilleError: The recordings folder or the TLS files cannot be used.
        """
        folder = self.settings.recordings
        try:
            if isinstance(self.storage, Folder):
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RobotouilleError(f"the recordings folder {folder}: {error.strerror}") from None
        self.listener.load_tls()
        self._used_tokens.forget_expired()
        # This happens before clients can connect, so that they find their rooms.
        self.lobby.recover()
        await self.listener.listen()
        self.lobby.start_patience()
        get_logger().info("listening", url=self.url)

    @property
    def port(self) -> int:
        """Port in use."""
        return self.listener.port

    @property
    def url(self) -> str:
        """Address for clients on this machine."""
        return self.listener.url

    @property
    def public_url(self) -> str:
        """Address for people: with TLS, the first name in the certificate."""
        return self.listener.public_url

    @property
    def tls(self) -> ServerTLS | None:
        """Certificate of the server, if it uses TLS."""
        return self.listener.tls

    @property
    def open_count(self) -> int:
        """Number of open connections and rooms."""
        return len(self.connections.open) + len(self.lobby.rooms)

    @property
    def closed_count(self) -> int:
        """Number of connections and rooms that no longer exist."""
        connections = self.connections
        return connections.accepted - len(connections.open) + self.lobby.dropped

    async def drain(self, seconds: float) -> None:
        """Accept no more clients, and wait until all episodes have ended or time is up.

        Episodes that wait for participants go to the next process at once. An episode goes there,
        too, when a participant loses its connection: only there can the participant come back.

        Args:
            seconds: The time that running episodes have to finish.
        """
        self.lobby.drain()
        self.listener.refuse()
        for room in list(self.lobby.rooms.values()):
            if room.episode.phase is Phase.WAITING:
                self._hand_over(room)
        for session in list(self.sessions.by_id.values()):
            there = session.room
            idle = there is None or there.mirrored or not there.in_progress
            if idle and session.peer is not None:
                session.peer.close("server/restart", "restart", retry=True, status=1012)
        loop = asyncio.get_running_loop()
        deadline = loop.time() + seconds
        while self._playing() and loop.time() < deadline:  # noqa: ASYNC110
            await asyncio.sleep(DRAIN_CHECK_SECONDS)

    def _playing(self) -> bool:
        return any(room.episode.in_progress for room in self.lobby.rooms.values())

    async def stop(self, reason: str = "the server shuts down", *, hand_over: bool = False) -> None:
        """End all episodes, or leave them to the next process, and close all connections.

        Only the first call has an effect.

        Args:
            reason: The reason to send to clients.
            hand_over: Leave the episodes to the next process, if they are recorded.
        """
        if self.shutdown.begun:
            return
        hand_over = hand_over and self.storage is not None
        self.shutdown.begun = True
        notice = self.shutdown.notice = ShutdownNotice(reason, hand_over)
        self.lobby.drain()
        for room in list(self.lobby.rooms.values()):
            if hand_over and room.episode.phase is not Phase.ENDED:
                self.lobby.suspend(room.id)
                continue
            try:
                # Each room ends on its own, because an error in one episode must not keep the
                # others from ending properly.
                room.abort(reason)
                room.broadcaster.deliver_now()
            except Exception:
                get_logger().exception("the episode failed", episode=room.id)
        # The end of an episode is sent once it is recorded.
        await self.settle()
        for conversation, _ in list(self.connections.open.values()):
            notice.send(conversation.peer)
        # This happens before the connections are closed, because sessions must not count as absent
        # while the server stops.
        self.sessions.stop()
        await self.listener.close(reason)
        await self.lobby.closed()
        await self.lobby.stop()
        if self.listener.sockets:  # If the server did not start, its caller reports the reason.
            get_logger().info("stopped", reason=reason)

    def _disconnected(self, session: Session) -> None:
        """Keep the session of a lost connection for a while."""
        session.disconnected()
        if self.shutdown.begun:
            return
        room, draining = session.room, self.lobby.draining
        if draining and session.players and room is not None and self._hand_over(room):
            return
        self.sessions.disconnected(session)

    def _hand_over(self, room: JoinedRoom) -> bool:
        """Leave an episode that has not ended to the next process, if it is recorded."""
        if self.storage is None or room.ended:
            return False
        for member in self.lobby.suspend(room.id):
            if member.peer is not None:
                member.peer.close("server/restart", "handed over", retry=True, status=1012)
        return True

    # Operators

    def announce(self, text: str) -> None:
        """Send an announcement to all participants of all episodes."""
        for room in list(self.lobby.rooms.values()):
            room.announce(text)

    def authorize(self, token: str) -> RoleGrant:
        """Return the content of an operator's token.

        Raises:
            ProtocolError: `auth/role`, `auth/invalid`, `auth/expired` or `auth/revoked`.
        """
        grant = self.tokens.check_role(token)
        if grant.role is not Role.OPERATOR:
            raise ProtocolError("auth/role", "this needs a token with the role operator", "token")
        return grant

    def sample(self, now: float) -> None:
        """Measure the resources that alerts are about, unless that was done just before."""
        self.health.sample(now, self.sessions.by_id.values())

    def alerts(self) -> list[Alert]:
        """Return the alerts for the operator, as of the last sample."""
        found = alerts(self.health)
        if self.audit.problem:
            found.insert(0, Alert("audit", self.audit.problem, "critical"))
        return found


def _always() -> bool:
    return True


async def _nothing_to_settle() -> None:
    """Return at once: files are written when events happen."""


def _with_storage(settings: ServerSettings, around: Surroundings) -> Surroundings:
    if not settings.record:
        return replace(around, storage=None)
    if around.storage is None:
        return replace(around, storage=Folder(settings.recordings))
    return around


@asynccontextmanager
async def serve(
    settings: ServerSettings, around: Surroundings | None = None
) -> AsyncIterator[Server]:
    """Run a server for the time of an `async with` block.

    When the context is left, all episodes end, unless `Server.stop` was called before. An exception
    leaves them to the next process.

    Args:
        settings: The settings of the server.
        around: Sources of time, chance and storage, which tests replace.

    Raises:
        RobotouilleError: The server cannot start: the address is not available, or the keys,
            folders, TLS files or a setting cannot be used.
    """
    server = Server(settings, around)
    try:
        await server.start()
        yield server
    except BaseException:
        # An internal error must not cost the players their episodes.
        await server.stop("the server failed", hand_over=True)
        raise
    finally:
        await server.stop()
