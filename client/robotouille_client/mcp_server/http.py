"""Streamable HTTP: access control and the HTTP service."""

from __future__ import annotations

import asyncio
import gc
import socket
import time
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import h11
import uvicorn
from mcp.server.transport_security import TransportSecuritySettings
from mcp.types import INVALID_REQUEST
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from robotouille.web.bounded_requests import BoundedRequests
from robotouille_client.mcp_server.limits import (
    MAX_BODY_BYTES,
    MAX_BODY_VALUES,
    MAX_CONNECTIONS,
    MAX_CONNECTIONS_OF_ADDRESS,
    MAX_SESSIONS,
    REQUEST_SECONDS,
)
from robotouille_client.mcp_server.sessions import SessionKeeper, address_group

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

    from robotouille_client.mcp_server.open_games import OpenGames

PATH = "/mcp"
ACCEPTED_AT_ONCE = 2
"""Connections accepted in a row, before existing connections get a turn."""
WAITING_TO_BE_ACCEPTED = 1024
"""Connections that the operating system queues."""
CLOSE = {"connection": "close"}
"""Header of answers to requests that get no turn. New connections are accepted a few at a time."""
LOOPBACK = ("127.0.0.1", "localhost", "::1")


def is_loopback(host: str) -> bool:
    """Return whether a host name or address can be reached from this machine only."""
    return host in LOOPBACK


def http_app(
    server: MCPServer[OpenGames],
    games: OpenGames,
    *,
    allowed_hosts: Sequence[str] = (),
    idle_seconds: float,
) -> ASGIApp:
    """Return the ASGI application.

    Args:
        games: The open games of the server.
        allowed_hosts: Host names in addition to those of loopback. With any, every request needs
            a bearer token.
        idle_seconds: Time after which an unused MCP session is closed.
    """
    app = server.streamable_http_app(
        streamable_http_path=PATH,
        max_request_body_size=MAX_BODY_BYTES,
        max_sessions=MAX_SESSIONS,
        session_idle_timeout=idle_seconds,
        transport_security=_guard(allowed_hosts),
    )
    needs_token = bool(allowed_hosts)
    keeper = SessionKeeper(app, games, idle_seconds, time.monotonic, needs_token=needs_token)
    return _WholeRequests(keeper)


def _guard(allowed_hosts: Sequence[str]) -> TransportSecuritySettings:
    # Without this check, a web page could reach the server through DNS rebinding: a name of its
    # own that resolves to this machine.
    local = [f"[{host}]" if ":" in host else host for host in LOOPBACK]
    names = [*local, *allowed_hosts]
    return TransportSecuritySettings(
        enable_dns_rebinding_protection=True,
        allowed_hosts=[form for name in names for form in (name, f"{name}:*")],
        allowed_origins=[
            *(form for name in local for form in (f"http://{name}", f"http://{name}:*")),
            *(form for name in allowed_hosts for form in (f"https://{name}", f"https://{name}:*")),
        ],
    )


class _WholeRequests:
    """Middleware that waits for the whole request before it calls the application.

    Slow or vanished clients then open no session and cause no traceback.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        try:
            async with asyncio.timeout(REQUEST_SECONDS):
                body = await _body(receive)
        except TimeoutError:
            await PlainTextResponse("Request Timeout", 408)(scope, receive, send)
            return
        if body is None:
            return
        if len(body) > MAX_BODY_BYTES:
            refusal = PlainTextResponse("Request body too large", 413, headers=CLOSE)
            await refusal(scope, receive, send)
            return
        if _values(body) > MAX_BODY_VALUES:
            await _too_many_values()(scope, receive, send)
            return
        whole: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

        async def again() -> Message:
            return whole.pop() if whole else await receive()

        await self._app(scope, again, send)


async def _body(receive: Receive) -> bytes | None:
    """Return the request's body, too much of it if it is too long, or None without a client."""
    body = bytearray()
    while len(body) <= MAX_BODY_BYTES:
        message = await receive()
        if message["type"] != "http.request":
            return None
        body += message.get("body", b"")
        if not message.get("more_body", False):
            break
    return bytes(body)


def _values(body: bytes) -> int:
    """Return the number of values in a JSON text, or up to twice as many."""
    # Texts may contain any number of the marks below. Without a zero byte, the text is UTF-8, and
    # each quotation mark begins or ends a text unless there is a backslash before it.
    if b"\0" not in body:
        body = body.replace(rb"\\", b"").replace(rb"\"", b"")
        body = b"".join(body.split(b'"')[::2])
    return sum(map(body.count, (b",", b"[", b"{")))


def _too_many_values() -> Response:
    error = {
        "code": INVALID_REQUEST,
        "message": f"the request has more than {MAX_BODY_VALUES:,} values",
    }
    body = {"jsonrpc": "2.0", "id": None, "error": error}
    return JSONResponse(body, status_code=400, headers=CLOSE)


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a listening socket.

    Raises:
        OSError: The address cannot be used.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    return socket.create_server((host, port), family=family, backlog=WAITING_TO_BE_ACCEPTED)


class _OpenConnections:
    """Open connections, the oldest first, all together and by what their address counts as.

    Hundreds of silent connections would otherwise block all other clients. At a limit, a new
    connection therefore replaces the one that has been silent for the longest time.
    """

    def __init__(self) -> None:
        self._all: dict[_Impatient, None] = {}
        self._groups: dict[str, dict[_Impatient, None]] = {}

    def add(self, new: _Impatient) -> None:
        """Add a connection. Above a limit, close the longest silent one, or the new one."""
        group = self._groups.setdefault(new.group, {})
        limit = MAX_CONNECTIONS_OF_ADDRESS if new.group else MAX_CONNECTIONS
        group[new] = self._all[new] = None
        for connections, most in ((group, limit), (self._all, MAX_CONNECTIONS)):
            if len(connections) > most:
                silent = (c for c in connections if c.is_silent and c is not new)
                self._close(_oldest(silent) or new)

    def remove(self, gone: _Impatient) -> None:
        """Remove a connection, if it is still there."""
        self._all.pop(gone, None)
        if group := self._groups.get(gone.group):
            group.pop(gone, None)
            if not group:
                del self._groups[gone.group]

    def _close(self, connection: _Impatient) -> None:
        self.remove(connection)
        connection.transport.abort()


def _oldest(silent: Iterator[_Impatient]) -> _Impatient | None:
    """Return the first connection that has never sent a request, or else the first one."""
    first = next(silent, None)
    if first is None or first.cycle is None:
        return first
    return next((c for c in silent if c.cycle is None), first)


class _Impatient(H11Protocol):
    """HTTP connection that is closed if its client does not send a whole request in time.

    Attributes:
        group: The address of the client, or its network; empty on this machine.
    """

    group = ""
    _check: asyncio.TimerHandle
    _awaited: object = None

    def __init__(self, open_connections: _OpenConnections, **given: Any) -> None:
        super().__init__(**given)
        self._open = open_connections

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.conn = BoundedRequests()
        self.group = address_group(self.client[0] if self.client else "")
        self._awaited = self._waits_for()
        self._check_later()
        self._open.add(self)

    @property
    def is_silent(self) -> bool:
        """True unless a request is being answered."""
        return self._waits_for() is not None

    def connection_lost(self, exc: Exception | None) -> None:
        self._check.cancel()
        self._open.remove(self)
        super().connection_lost(exc)

    def _waits_for(self) -> object:
        # The request whose head or body is missing, the client that must read the last answer, or
        # None while a request is being answered.
        if self.transport.is_closing():
            return "the end"
        state = self.conn.their_state
        return (self.cycle, state) if state in (h11.IDLE, h11.SEND_BODY) else None

    def _check_later(self) -> None:
        self._check = self.loop.call_later(REQUEST_SECONDS, self._check_now)

    def _check_now(self) -> None:
        before, self._awaited = self._awaited, self._waits_for()
        if before is not None and before == self._awaited:
            self.transport.abort()
        else:
            self._check_later()


class HttpService(uvicorn.Server):
    """HTTP server that runs until SIGINT or SIGTERM."""

    def __init__(self, app: ASGIApp, games: OpenGames) -> None:
        super().__init__(
            uvicorn.Config(
                app,
                http=cast("Any", partial(_Impatient, _OpenConnections())),
                backlog=ACCEPTED_AT_ONCE,
                log_level="critical",  # Strangers can cause warnings and errors at will.
                access_log=False,
                server_header=False,
                # Connections that were replaced still count for a moment.
                limit_concurrency=2 * MAX_CONNECTIONS,
                timeout_graceful_shutdown=3,
            )
        )
        self._games = games

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listen on the sockets."""
        await super().startup(sockets)
        for listening in sockets or ():
            # asyncio uses one number both for the queue and for the connections accepted in a row.
            listening.listen(WAITING_TO_BE_ACCEPTED)
        # A full garbage collection over the library and its schemas takes 90 ms.
        gc.collect()
        gc.freeze()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Leave all games and stop."""
        # The games are closed first, which answers the calls that wait for them.
        await self._games.close_all()
        await super().shutdown(sockets)
