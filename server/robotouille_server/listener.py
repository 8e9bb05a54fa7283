"""Listening sockets of a server, HTTP pages on the same port, and open connections."""

from __future__ import annotations

import asyncio
import contextlib
import errno
from collections.abc import Callable
from functools import partial
from http import HTTPStatus

from websockets.http11 import Request, Response

from robotouille.errors import RobotouilleError
from robotouille.protocol.codec import codec_for
from robotouille.web import shared_site
from robotouille_server.auth import (
    CountedConnection,
    Visitor,
    comes_from,
    newcomer_group,
    newcomer_turn_group,
    origin_refusal,
    parse_networks,
    parse_origins,
    visitor,
)
from robotouille_server.conversation import Conversation
from robotouille_server.requests import Services
from robotouille_server.rooms.participants.session import Session
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.workers import WorkerSlot
from robotouille_server.transport import (
    Admission,
    Connection,
    Peer,
    PendingConnection,
    ServerTLS,
)
from robotouille_server.web_pages import (
    OwnSite,
    WebPages,
    is_host_name,
    parse_consent,
    parse_names,
)


class HttpPages:
    """HTTP requests on the port of the WebSocket: probes, `/metrics`, the page, and refusals.

    `/healthz` is answered as long as the process works, `/readyz` while clients should come.

    Args:
        settings: The server's settings.
        full: Returns whether the server accepts no further connections.
        ready: Returns whether new clients should come to this process.
        metrics_page: Returns the metrics at a time of the event loop.
        worker: The position of this process among the workers.
    """

    def __init__(
        self,
        settings: ServerSettings,
        full: Callable[[], bool],
        ready: Callable[[], bool],
        metrics_page: Callable[[float], bytes],
        worker: WorkerSlot,
    ) -> None:
        self._full = full
        self._ready = ready
        self._metrics_page = metrics_page
        self._proxies = parse_networks(settings.trust_proxy, "--trust-proxy")
        self._metrics_from = parse_networks(settings.metrics_from, "--metrics-from")
        self._origins = parse_origins(settings.origins)
        ports = range(worker.first_port, worker.first_port + worker.count)
        self._own = OwnSite(
            parse_names(settings.page_names),
            {settings.port, *ports},
            parse_origins(settings.page_parents, "--page-parents"),
        )
        consent = parse_consent(settings.page_consent)
        self._web = WebPages(shared_site(), self._own, consent) if settings.page else None

    def listens(self, name: str, port: int) -> None:
        """Add the name of a certificate, which may be empty, and a port to the server's own."""
        self._own.ports.add(port)
        # A certificate may name a whole domain, such as `*.example.org`.
        if is_host_name(name):
            self._own.names.add(name.lower())

    def visitor(self, connection: Connection, request: Request) -> Visitor:
        """Return where a request comes from."""
        return visitor(connection.remote_address, request.headers, self._proxies)

    def newcomer_group(self, peer: object) -> str:
        """Return what a connection without a request counts as; empty for no limit."""
        return newcomer_group(peer, self._proxies)

    def newcomer_turn_group(self, peer: object) -> str | None:
        """Return the group with which a connection without a request shares turns."""
        return newcomer_turn_group(peer, self._proxies)

    def answer(self, connection: Connection, request: Request) -> Response | None:
        """Answer a request; return None to go on with the WebSocket handshake."""
        # Before version 17, the library has no methods: it closes the connection if it is not GET.
        if getattr(request, "method", "GET") != "GET":
            refusal = connection.respond(HTTPStatus.METHOD_NOT_ALLOWED, "only GET is answered\n")
            refusal.headers["Allow"] = "GET"
            return refusal
        path = request.path.partition("?")[0]
        # This comes before the check for a full server, which is healthy: a restart would end its
        # episodes.
        if path == "/healthz":
            return connection.respond(HTTPStatus.OK, "ok\n")
        if path == "/readyz":
            if self._ready():
                return connection.respond(HTTPStatus.OK, "ready\n")
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "not ready\n")
        if path == "/metrics":
            return self._metrics(connection, request)
        if self._full():
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "the server is full\n")
        if "websocket" not in ",".join(request.headers.get_all("Upgrade")).lower():
            return self._page(connection, path, request)
        if self._web is not None and self._own.has_page(request.headers):
            return None
        problem = origin_refusal(request.headers, self._origins)
        if problem is not None:
            return connection.respond(HTTPStatus.FORBIDDEN, problem)
        return None

    def _page(self, connection: Connection, path: str, request: Request) -> Response:
        page = self._web.answer(path, request.headers) if self._web is not None else None
        if page is None:
            text = "This is a Robotouille server. Play: robotouille-client --url ws://…\n"
            return connection.respond(HTTPStatus.UPGRADE_REQUIRED, text)
        connection.charge(len(page.body or b"") / 1024)
        return page

    def _metrics(self, connection: Connection, request: Request) -> Response:
        peer, headers = connection.remote_address, request.headers
        local = self.visitor(connection, request).local
        if not local and not comes_from(peer, headers, self._metrics_from):
            text = "only this machine and the addresses of --metrics-from may read the metrics\n"
            return connection.respond(HTTPStatus.FORBIDDEN, text)
        page = self._metrics_page(connection.loop.time()).decode()
        response = connection.respond(HTTPStatus.OK, page)
        del response.headers["Content-Type"]
        response.headers["Content-Type"] = "text/plain; version=0.0.4; charset=utf-8"
        return response


class Connections:
    """Open connections, in the order in which they arrived.

    Args:
        services: The parts of the server that conversations use.
        admission: Limits connections that have not sent anything yet.
        pages: Answers HTTP requests.
        disconnected: Called with the session of a connection that is gone.
    """

    def __init__(
        self,
        services: Services,
        admission: Admission,
        pages: HttpPages,
        disconnected: Callable[[Session], None],
    ) -> None:
        self.open: dict[Connection, tuple[Conversation, CountedConnection]] = {}
        self.accepted = 0
        self._services = services
        self._admission = admission
        self._pages = pages
        self._disconnected = disconnected

    def accept(self) -> PendingConnection:
        """Return the protocol of a new connection."""
        self.accepted += 1
        return PendingConnection(self, self._admission)

    def answer(self, connection: Connection, request: Request) -> Response | None:
        """Answer an HTTP request; return None to go on with the WebSocket handshake."""
        return self._pages.answer(connection, request)

    def opened(self, connection: Connection, request: Request) -> None:
        """Serve a connection after its handshake."""
        services = self._services
        who = self._pages.visitor(connection, request)
        connection.share_turns(who.turn_group)
        codec = codec_for(connection.subprotocol)
        peer = Peer(connection, codec, services.metrics, services.settings.stall_seconds)
        counted = CountedConnection(who, partial(self._displace, peer))
        conversation = Conversation(services, peer, counted)
        self.open[connection] = conversation, counted
        connection.receiver = conversation.receive
        services.metrics.connections.set(len(self.open))
        services.connection_limiter.arrive(counted)

    def lost(self, connection: Connection) -> None:
        """Forget a connection, which may not have been opened."""
        served = self.open.pop(connection, None)
        if served is None:
            return
        conversation, counted = served
        services = self._services
        services.metrics.connections.set(len(self.open))
        services.connection_limiter.release(counted)
        conversation.close()
        session = conversation.session
        # Another connection may have taken the session over.
        if session is not None and session.peer is conversation.peer:
            self._disconnected(session)

    def _displace(self, peer: Peer) -> None:
        """Close a connection that has not sent hello, because a newer one needs its place."""
        self._services.metrics.dropped.labels("displaced").inc()
        text = "too many connections from your address have not sent hello"
        peer.close("rate/connections", text, retry=True, status=1013)


ACCEPTED_AT_ONCE = 32
"""Connections accepted in a row, before existing connections get a turn."""
WAITING_TO_BE_ACCEPTED = 4096
"""Connections that the operating system queues."""
EVERYWHERE, EVERYWHERE_IPV6 = "0.0.0.0", "::"  # noqa: S104
"""Addresses for all interfaces. The second one includes the first."""
CLOSE_SECONDS, ABORT_SECONDS = 5.0, 1.0
"""Seconds that clients have to close their connections, and that aborted connections take."""


class CannotListenError(RobotouilleError):
    """The address is in use or does not belong to this machine."""


class Listener:
    """Listening sockets: the shared port, and the worker's own port if there are several."""

    def __init__(
        self,
        settings: ServerSettings,
        worker: WorkerSlot,
        connections: Connections,
        pages: HttpPages,
        admission: Admission,
    ) -> None:
        self.sockets: list[asyncio.Server] = []
        self._settings = settings
        self._worker = worker
        self._connections = connections
        self._pages = pages
        self._admission = admission
        self._port = settings.port
        self._tls: ServerTLS | None = None
        self._watching: asyncio.Task[None] | None = None

    def load_tls(self) -> None:
        """Load the certificate, if there is one, and reload it whenever its file changes."""
        settings = self._settings
        if settings.tls_cert is not None or settings.tls_key is not None:
            self._tls = ServerTLS.from_settings(settings.tls_cert, settings.tls_key)
            self._watching = asyncio.create_task(self._tls.watch())
            self._admission.tls = self._tls

    async def listen(self) -> None:
        """Listen on all ports.

        Raises:
            CannotListenError: An address is not available.
        """
        shared = self._worker.count > 1
        await self._listen(self._settings.port, shared=shared)
        if shared:
            await self._listen(self._worker.first_port + self._worker.index, shared=False)

    async def _listen(self, port: int, *, shared: bool) -> None:
        host = self._settings.host
        # asyncio's sockets for IPv6 admit no IPv4, but `::` means all interfaces.
        for each in (host, EVERYWHERE) if host == EVERYWHERE_IPV6 else (host,):
            port = await self._listen_on(each, port, shared=shared)

    async def _listen_on(self, host: str, port: int, *, shared: bool) -> int:
        """Listen on an address, and return the port."""
        try:
            socket = await asyncio.get_running_loop().create_server(
                self._connections.accept,
                host,
                port,
                # A burst of new connections must not delay the steps of running episodes.
                backlog=ACCEPTED_AT_ONCE,
                reuse_port=shared or None,
            )
        except OSError as error:
            where = f"{host}:{port}"
            other = "; choose another port with --port" if error.errno == errno.EADDRINUSE else ""
            message = f"cannot listen on {where}: {error.strerror}{other}"
            raise CannotListenError(message) from None
        for listening in socket.sockets:
            # asyncio uses one number both for the queue and for the connections accepted in a row.
            with listening.dup() as same:
                same.listen(WAITING_TO_BE_ACCEPTED)
        bound = int(next(iter(socket.sockets)).getsockname()[1])
        self._pages.listens(self._tls.name if self._tls is not None else "", bound)
        if not self.sockets:
            # Noted here, because a draining server has closed its sockets.
            self._port = bound
        self.sockets.append(socket)
        return bound

    # Addresses

    @property
    def port(self) -> int:
        """Port in use, also after `refuse`."""
        return self._port

    @property
    def url(self) -> str:
        """Address for clients on this machine."""
        host = self._settings.host
        return self._url("127.0.0.1" if host in (EVERYWHERE, EVERYWHERE_IPV6) else host)

    @property
    def public_url(self) -> str:
        """Address for people: with TLS, the first name in the certificate."""
        name = self._tls.name if self._tls is not None else ""
        return self._url(name) if name else self.url

    @property
    def page_url(self) -> str:
        """Address of the page for people, without a code; empty if the page is turned off."""
        if not self._settings.page:
            return ""
        return f"http{self.public_url.removeprefix('ws')}/play"

    def _url(self, host: str) -> str:
        scheme = "wss" if self._tls is not None else "ws"
        return f"{scheme}://{f'[{host}]' if ':' in host else host}:{self.port}"

    @property
    def tls(self) -> ServerTLS | None:
        """Certificate of the server, if it uses TLS."""
        return self._tls

    # The end

    def refuse(self) -> None:
        """Accept no more connections."""
        for socket in self.sockets:
            socket.close()

    async def close(self, reason: str) -> None:
        """Close all connections politely, then abort those that do not react."""
        self.refuse()
        self._admission.close()
        for connection in list(self._connections.open):
            connection.say_goodbye(1001, reason)
        for seconds in (CLOSE_SECONDS, ABORT_SECONDS):
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(seconds):
                    await self._admission.wait_empty()
            for connection in self._connections.open:
                connection.abort()
        if self._watching is not None:
            self._watching.cancel()
