"""Streamable HTTP: access control and the HTTP service."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import h11
import uvicorn
from mcp.server.transport_security import TransportSecuritySettings
from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from robotouille.web.bounded_requests import BoundedRequests
from robotouille_client.mcp_server.open_games import bearer
from robotouille_client.mcp_server.sessions import (
    MAX_SESSIONS,
    SessionKeeper,
    address_group,
    invalid_token,
)

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

    from robotouille_client.mcp_server.open_games import OpenGames

PATH = "/mcp"
MAX_BODY_BYTES = 65_536
MAX_CONNECTIONS = 512
MAX_CONNECTIONS_OF_ADDRESS = 64
REQUEST_SECONDS = 10.0
"""Time limit for the head of a request, and for its body."""
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
    kept = _WholeRequests(SessionKeeper(app, games, idle_seconds, time.monotonic))
    return _TokenRequired(kept) if allowed_hosts else kept


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
            await PlainTextResponse("Request body too large", 413)(scope, receive, send)
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


class _TokenRequired:
    """Middleware that refuses requests without a bearer token."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and not bearer(Headers(scope=scope).get("authorization")):
            refusal = invalid_token("send a role token as bearer token")
            await refusal(scope, receive, send)
            return
        await self._app(scope, receive, send)


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a listening socket.

    Raises:
        OSError: The address cannot be used.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    return socket.create_server((host, port), family=family, backlog=128)


class _Impatient(H11Protocol):
    """HTTP connection that is closed if its client does not send a whole request in time.

    Hundreds of silent connections would otherwise block all other clients. At the limit, a new
    connection therefore replaces the one that has been silent for the longest time.
    """

    _check: asyncio.TimerHandle
    _awaited: object = None
    _since = 0.0
    _group = ""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.conn = BoundedRequests()
        self._group = address_group(self.client[0] if self.client else "")
        self._since = self.loop.time()
        self._awaited = self._waits_for()
        self._check_later()
        others = [c for c in self.connections if isinstance(c, _Impatient) and c.is_open]
        self._replace_one([c for c in others if c._group == self._group], self._address_limit)
        self._replace_one([c for c in others if c.is_open], MAX_CONNECTIONS)

    @property
    def is_open(self) -> bool:
        """False once the connection is being closed."""
        return not self.transport.is_closing()

    @property
    def _address_limit(self) -> int:
        return MAX_CONNECTIONS_OF_ADDRESS if self._group else MAX_CONNECTIONS

    def _replace_one(self, connections: list[_Impatient], limit: int) -> None:
        """Close the longest silent connection, or this one, if there are too many."""
        if len(connections) > limit:
            silent = [c for c in connections if c._waits_for() is not None and c is not self]
            # Connections that have never sent a request come first.
            oldest = min(silent, key=lambda c: (c.cycle is not None, c._since), default=self)
            oldest.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        self._check.cancel()
        super().connection_lost(exc)

    def _waits_for(self) -> object:
        # The request whose head or body is missing, or None while a request is being answered.
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
                http=_Impatient,
                log_level="error",  # Strangers can cause warnings at will.
                access_log=False,
                server_header=False,
                # Connections that were replaced still count for a moment.
                limit_concurrency=2 * MAX_CONNECTIONS,
                timeout_graceful_shutdown=3,
            )
        )
        self._games = games

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Leave all games and stop."""
        # The games are closed first, which answers the calls that wait for them.
        await self._games.close_all()
        await super().shutdown(sockets)
