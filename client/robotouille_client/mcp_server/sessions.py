"""MCP sessions over HTTP: who may open one, who owns it, and which one ends to make room."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import math
from collections import Counter, OrderedDict
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mcp.server.auth.middleware.bearer_auth import AuthenticatedUser
from mcp.server.auth.provider import AccessToken
from mcp.types import INVALID_REQUEST
from mcp_types.version import HANDSHAKE_PROTOCOL_VERSIONS
from pydantic import ValidationError
from starlette.datastructures import Headers
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol.error_codes import ErrorCode
from robotouille_client.mcp_server.limits import (
    MAX_NEWCOMERS,
    MAX_REQUESTS_OF_TOKEN,
    MAX_SESSIONS,
    MAX_SESSIONS_OF_ADDRESS,
    MAX_SESSIONS_OF_TOKEN,
)
from robotouille_client.mcp_server.open_games import SESSION_HEADER, Caller, bearer, counted
from robotouille_client.mcp_server.turns import Turn, Turns

if TYPE_CHECKING:
    from robotouille_client.mcp_server.open_games import OpenGames

NEWCOMERS = "newcomers"
"""Key for the turns of all tokens that are not known. Strangers with made-up tokens therefore delay
the requests of others no more than one token does."""
CHECKS_AT_ONCE = 8
"""New tokens that the game server checks at the same time, and known ones that it checks again."""
CHECK_SECONDS = 10.0
RECHECK_SECONDS = 30.0
"""Seconds after which the next request with a token checks the token again."""
MAX_ACCEPTED = 1024
"""Accepted tokens that are remembered."""
VERSION_HEADER = "mcp-protocol-version"


def address_group(address: str) -> str:
    """Return what an address counts as: itself, its IPv6 /64 network, or nothing on loopback.

    Loopback has no limit, because a proxy on this machine makes all clients look local.
    """
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address
    if found.is_loopback:
        return ""
    if found.version == 6:
        return str(ipaddress.ip_network((address, 64), strict=False))
    return address


@dataclass(slots=True)
class McpSession:
    """An open session.

    Attributes:
        calls: The number of requests in progress.
    """

    id: str
    caller: Caller
    group: str
    last_used: float
    calls: int = 0


@dataclass(slots=True)
class _Answer:
    """Response to a request, with the session that it names."""

    send: Send
    status: int = 500
    session: str = ""

    async def watch(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.status = message["status"]
            self.session = Headers(raw=message["headers"]).get(SESSION_HEADER, "")
        await self.send(message)


def _ending(turn: Turn, scope: Scope, send: Send) -> Send:
    """Return `send` that ends a turn when the work of the request is done.

    The client of an event stream waits for hours, and any client may not read its answer.
    """

    async def ending(message: Message) -> None:
        if message.get("body") or scope["method"] == "GET":
            turn.end()
        await send(message)

    return ending


async def _unless_gone(receive: Receive) -> Receive | None:
    """Return `receive` as it was, or None if the client has closed its connection.

    Calls with the id of another one are never answered, so each of thousands of abandoned ones
    would take the longest time of a turn.
    """
    unread = [await receive()]
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(0):
            if (await receive())["type"] == "http.disconnect":
                return None

    async def again() -> Message:
        return unread.pop() if unread else await receive()

    return again


class SessionKeeper:
    """Middleware that checks tokens, binds sessions to them and limits sessions and requests.

    The library refuses new sessions at its limit, so one client could lock out all others for the
    idle time. This middleware instead ends the session that was unused for the longest time.
    Sessions with a game stay. All requests wait for a turn, also those that are refused.

    Args:
        needs_token: Refuse requests without a bearer token.
    """

    def __init__(
        self,
        app: ASGIApp,
        games: OpenGames,
        idle_seconds: float,
        now: Callable[[], float],
        *,
        needs_token: bool = False,
    ) -> None:
        self._app = app
        self._games = games
        self._idle_seconds = idle_seconds
        self._now = now
        self._needs_token = needs_token
        self._turns = Turns()
        self._sessions: dict[str, McpSession] = {}
        self._opening: list[McpSession] = []
        self._first_checks = asyncio.Semaphore(CHECKS_AT_ONCE)
        self._rechecks = asyncio.Semaphore(CHECKS_AT_ONCE)
        # The owners of accepted tokens, with the time of the last check.
        self._accepted: OrderedDict[str, float] = OrderedDict()
        self._calls: Counter[str] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        caller = Caller(bearer(headers.get("authorization")), alone=False)
        if not self._is_known(caller, headers):
            refusal = await self._newcomer_refusal(caller, headers)
            if refusal is not None:
                await refusal(scope, receive, send)
                return
        await self._serve(caller, headers, (scope, receive, send))

    def _is_known(self, caller: Caller, headers: Headers) -> bool:
        if not caller.token:
            return not self._needs_token
        session = self._sessions.get(headers.get(SESSION_HEADER, ""))
        uses_own = session is not None and session.caller.owner == caller.owner
        return uses_own or caller.owner in self._accepted or self._games.plays(caller)

    async def _newcomer_refusal(self, caller: Caller, headers: Headers) -> Response | None:
        """Return the answer to a caller whose token is not known, or None if it is accepted."""
        if self._calls[NEWCOMERS] >= MAX_NEWCOMERS:
            return _unavailable(f"{MAX_NEWCOMERS} requests with unknown tokens wait")
        with counted(self._calls, NEWCOMERS):
            async with self._first_checks, self._turns.turn(NEWCOMERS):
                if not caller.token:
                    return invalid_token("send a role token as bearer token")
                if SESSION_HEADER in headers:
                    return _no_session()
                return await self._refusal(caller)

    async def _serve(
        self, caller: Caller, headers: Headers, request: tuple[Scope, Receive, Send]
    ) -> None:
        scope, receive, send = request
        if caller.token and self._calls[caller.owner] >= MAX_REQUESTS_OF_TOKEN:
            refusal = _unavailable(f"{MAX_REQUESTS_OF_TOKEN} calls of this token are in progress")
            await refusal(scope, receive, send)
            return
        with counted(self._calls, caller.owner):
            async with self._turns.turn(caller.owner) as turn:
                # A program that ends may not wait for the answer to its `DELETE`.
                if scope["method"] == "POST":
                    found = await _unless_gone(receive)
                    if found is None:
                        return
                    receive = found
                await self._answer(caller, headers, (scope, receive, _ending(turn, scope, send)))

    async def _answer(
        self, caller: Caller, headers: Headers, request: tuple[Scope, Receive, Send]
    ) -> None:
        scope, receive, send = request
        scope = {**scope, **_identity(caller)}
        if session := headers.get(SESSION_HEADER):
            await self._use(session, caller, (scope, receive, send))
        elif refusal := await self._refusal(caller):
            await refusal(scope, receive, send)
        elif _opens_session(scope, headers):
            await self._open(caller, (scope, receive, send))
        else:
            await self._app(scope, receive, send)

    async def _use(self, name: str, caller: Caller, request: tuple[Scope, Receive, Send]) -> None:
        scope, receive, send = request
        session = self._sessions.get(name)
        if session is None or session.caller.owner != caller.owner:
            # The library answers 404, because the session has ended or belongs to another token.
            await self._app(scope, receive, send)
            return
        if await self._is_revoked(caller):
            await self._end(session, scope)
            await self._games.end_session(name, caller.owner)
            await invalid_token("the operator has revoked the token")(scope, receive, send)
            return
        answer = _Answer(send)
        session.calls += 1
        session.last_used = self._now()
        try:
            await self._app(scope, receive, answer.watch)
        finally:
            session.calls -= 1
            session.last_used = self._now()
        if answer.status == 404 or (scope["method"] == "DELETE" and answer.status < 300):
            self._sessions.pop(name, None)
            await self._games.end_session(name, caller.owner)

    async def _open(self, caller: Caller, request: tuple[Scope, Receive, Send]) -> None:
        scope, receive, send = request
        group = address_group((scope.get("client") or ("", 0))[0])
        new = McpSession("", caller, group, self._now())
        self._opening.append(new)
        answer = _Answer(send)
        try:
            if refusal := await self._make_room(new, scope):
                await refusal(scope, receive, send)
                return
            await self._app(scope, receive, answer.watch)
        finally:
            self._opening.remove(new)
        if answer.session and answer.status < 400:
            new.id, new.last_used = answer.session, self._now()
            self._sessions[new.id] = new

    async def _refusal(self, caller: Caller) -> Response | None:
        """Return the answer to a request without a session whose token is not accepted."""
        known = caller.owner in self._accepted
        error = await self._checked(caller, known=known)
        if error is None:
            return None
        if isinstance(error, ValidationError):  # Its text would repeat the token.
            return invalid_token("the token is too long or not a token")
        reason = error.message if isinstance(error, ProtocolError) else str(error)
        if isinstance(error, ProtocolError) and error.code.startswith("auth/"):
            if error.code != ErrorCode.AUTH_REVOKED and self._games.plays(caller):
                return None
            self._accepted.pop(caller.owner, None)
            return invalid_token(reason)
        return None if known else _unavailable(f"the game server cannot check the token: {reason}")

    async def _is_revoked(self, caller: Caller) -> bool:
        """Return whether the token of an open session was revoked."""
        error = await self._checked(caller, known=True)
        # Sessions go on with an expired token, and with one for a single session.
        revoked = isinstance(error, ProtocolError) and error.code == ErrorCode.AUTH_REVOKED
        if revoked:
            self._accepted.pop(caller.owner, None)
        return revoked

    async def _checked(
        self, caller: Caller, *, known: bool
    ) -> RobotouilleError | ValidationError | TimeoutError | None:
        """Ask the game server, from time to time, why it refuses a token; None if it accepts it."""
        last = self._accepted.get(caller.owner, -math.inf)
        if not caller.token or self._now() < last + RECHECK_SECONDS:
            return None
        if known:
            # Parallel requests of the token do not check it too.
            self._accept(caller)
        places = self._rechecks if known else nullcontext()
        try:
            async with asyncio.timeout(CHECK_SECONDS), places, self._games.visit(caller):
                self._accept(caller)
        except (RobotouilleError, ValidationError, TimeoutError) as error:
            return error
        return None

    def _accept(self, caller: Caller) -> None:
        self._accepted[caller.owner] = self._now()
        self._accepted.move_to_end(caller.owner)
        if len(self._accepted) > MAX_ACCEPTED:
            self._accepted.popitem(last=False)

    async def _make_room(self, new: McpSession, scope: Scope) -> Response | None:
        """End sessions without a game until the new one is within all limits."""
        self._forget_idle()
        # The narrowest limit comes first: a token at its own limit ends its own session, and then
        # the sessions of its neighbours are within theirs.
        limits: list[tuple[int, Callable[[McpSession], bool]]] = []
        if new.caller.token:
            limits.append((MAX_SESSIONS_OF_TOKEN, lambda s: s.caller.owner == new.caller.owner))
        if new.group:
            limits.append((MAX_SESSIONS_OF_ADDRESS, lambda s: s.group == new.group))
        limits.append((MAX_SESSIONS, lambda _: True))
        for limit, counts in limits:
            while len(list(filter(counts, [*self._sessions.values(), *self._opening]))) > limit:
                playing = self._games.sessions()
                unused = [s for s in self._sessions.values() if counts(s) and s.id not in playing]
                if not unused:
                    return _unavailable(f"{limit} MCP sessions are open; end one")
                await self._end(min(unused, key=lambda s: (s.calls > 0, s.last_used)), scope)
        return None

    def _forget_idle(self) -> None:
        # The library has ended these.
        long_ago = self._now() - self._idle_seconds
        self._sessions = {
            name: s for name, s in self._sessions.items() if s.calls or s.last_used > long_ago
        }

    async def _end(self, session: McpSession, scope: Scope) -> None:
        """End a session with the request that its client would send."""
        self._sessions.pop(session.id, None)
        headers = [(b"host", Headers(scope=scope).get("host", "").encode("latin-1"))]
        headers.append((SESSION_HEADER.encode(), session.id.encode()))
        request = {**scope, "method": "DELETE", "headers": headers, **_identity(session.caller)}
        await self._app(request, _nothing, _ignore)


def _opens_session(scope: Scope, headers: Headers) -> bool:
    version = headers.get(VERSION_HEADER)
    return scope["method"] == "POST" and (version is None or version in HANDSHAKE_PROTOCOL_VERSIONS)


def _identity(caller: Caller) -> Scope:
    """Return the part of a scope by which the library recognises the owner of a session."""
    if not caller.token:
        return {"user": None}
    return {"user": AuthenticatedUser(AccessToken(token="", client_id=caller.owner, scopes=[]))}


async def _nothing() -> Message:
    return {"type": "http.request", "body": b"", "more_body": False}


async def _ignore(_: Message) -> None:
    pass


def invalid_token(reason: str) -> Response:
    """Return the answer to a request without a valid token."""
    return JSONResponse(
        {"error": "invalid_token", "error_description": reason},
        status_code=401,
        headers={"www-authenticate": 'Bearer error="invalid_token"'},
    )


def _no_session() -> Response:
    error = {"code": INVALID_REQUEST, "message": "Session not found"}
    return JSONResponse({"jsonrpc": "2.0", "id": None, "error": error}, status_code=404)


def _unavailable(reason: str) -> Response:
    # New connections are accepted a few at a time, so refused clients cannot use up all turns.
    headers = {"retry-after": "1", "connection": "close"}
    return JSONResponse({"error": reason}, status_code=503, headers=headers)
