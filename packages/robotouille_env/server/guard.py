"""Limits on what strangers can send to the application: other web pages, and large bodies.

OpenEnv's server has neither. It also parses bodies of any type as JSON, so a web page of another
site could open sessions through the browser of the person who runs the server.
"""

from __future__ import annotations

import contextlib
import ipaddress
from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

MAX_BODY = 4 << 20
"""Bytes of a request's body or of a message: an answer of a model with many escaped characters."""


class Guard:
    """Middleware that refuses requests of web pages of other sites, and large bodies."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if not (_is_own_page(headers) and _names_this_machine(scope, headers)):
            await _refuse(scope, receive, send, 403, "web pages of other sites are not accepted")
        elif scope["type"] == "websocket":
            await self._app(scope, receive, send)
        elif int(headers.get("content-length") or 0) > MAX_BODY:
            await _refuse(scope, receive, send, 413, _TOO_LARGE)
        else:
            await self._with_limit(scope, receive, send)

    async def _with_limit(self, scope: Scope, receive: Receive, send: Send) -> None:
        size, answered = 0, False

        async def limited() -> Message:
            nonlocal size
            message = await receive()
            size += len(message.get("body", b""))
            # The application would answer an exception with a status of its own.
            return message if size <= MAX_BODY else {"type": "http.disconnect"}

        async def noted(message: Message) -> None:
            nonlocal answered
            if size <= MAX_BODY or answered:
                answered = True
                await send(message)

        with contextlib.suppress(ClientDisconnect):
            await self._app(scope, limited, noted)
        if size > MAX_BODY and not answered:
            await _refuse(scope, receive, send, 413, _TOO_LARGE)


_TOO_LARGE = f"the body is larger than {MAX_BODY >> 20} MiB"


def _is_own_page(headers: Mapping[str, str]) -> bool:
    """Return whether a request comes from a page of this server, or from a program."""
    origin = headers.get("origin")
    return origin is None or origin.partition("://")[2] == headers.get("host")


def _names_this_machine(scope: Scope, headers: Mapping[str, str]) -> bool:
    """Return whether a request within this machine names it by an address or `localhost`.

    Otherwise it may come from a page of another site whose name was made to lead here (DNS
    rebinding). Browsers take such a page for one of this server.
    """
    if not _is_loopback((scope.get("server") or ("",))[0]):
        return True
    with contextlib.suppress(ValueError):
        return _is_loopback(urlsplit(f"//{headers.get('host', '')}").hostname or "")
    return False


def _is_loopback(host: str) -> bool:
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host == "localhost"
    # Python before 3.13 does not see that ::ffff:127.0.0.1 is 127.0.0.1.
    mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return (mapped or address).is_loopback


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, why: str) -> None:
    # Otherwise, the server would go on to read a refused body.
    close = {"connection": "close"}
    answer: Any = JSONResponse({"detail": why}, status_code=status, headers=close)
    if scope["type"] == "websocket":
        answer = WebSocketClose(code=1008, reason=why)
    await answer(scope, receive, send)
