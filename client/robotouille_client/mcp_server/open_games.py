"""The open games of all MCP clients of this process, and access to them."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import secrets
from collections import Counter
from collections.abc import AsyncIterator, Iterable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal

from mcp.server.mcpserver import Context

from robotouille.errors import RobotouilleError
from robotouille.protocol.join_codes import plain_token
from robotouille_client.client import Client, connect
from robotouille_client.mcp_server.limits import MAX_GAMES_OF_TOKEN, MAX_VISITS_OF_TOKEN
from robotouille_client.mcp_server.open_game import OpenGame
from robotouille_client.mcp_server.turns import waiting

LOOK_SECONDS = 5.0
"""Seconds between two checks for games that nobody uses."""
LOST_SECONDS = 60.0
"""Seconds for which a game stays after the game server has closed its connection for good. In this
time, the client can read the reason."""


@dataclass(frozen=True, slots=True)
class Caller:
    """The caller of a tool.

    Attributes:
        alone: True if this process serves no other client.
        mcp_session: The caller's MCP session, in protocol versions that have sessions.
    """

    token: str | None = field(default=None, repr=False)
    name: str = "mcp-agent"
    alone: bool = True
    mcp_session: str | None = None

    @property
    def owner(self) -> str:
        """Key of the token. Callers with the same token, or without one, are the same owner."""
        return hashlib.sha256(plain_token(self.token).encode()).hexdigest() if self.token else ""


@contextmanager
def counted(counts: Counter[str], owner: str) -> Iterator[None]:
    """Count one more for an owner within the context."""
    counts[owner] += 1
    try:
        yield
    finally:
        _uncount(counts, owner)


def _uncount(counts: Counter[str], owner: str) -> None:
    counts[owner] -= 1
    # Anybody can make up tokens, so owners with a count of zero must not accumulate.
    if not counts[owner]:
        del counts[owner]


class OpenGames:
    """The open games by their handles.

    A handle is a secret that works only with the token of its owner. Use the games within
    `running`, which leaves idle and lost games, and all of them at the end.

    Args:
        token: Token of callers without their own.
        name: Name of callers without their own.
    """

    def __init__(
        self,
        url: str,
        *,
        token: str | None = None,
        name: str | None = None,
        max_games: int = 64,
        idle_seconds: float = 600.0,
    ) -> None:
        self.url = url
        self.token = token
        self.name = name
        self._max_games = max_games
        self._idle_seconds = idle_seconds
        self._games: dict[str, OpenGame] = {}
        self._places: Counter[str] = Counter()
        self._visits: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._games)

    @asynccontextmanager
    async def visit(self, caller: Caller) -> AsyncIterator[Client]:
        """Connect to the game server for one request.

        Raises:
            RobotouilleError: The caller makes too many requests, or the game server refuses.
        """
        with self._visit(caller):
            connection = connect(
                self.url, name=caller.name, kind="model", token=caller.token, reconnect=False
            )
            async with waiting(), connection as client:
                yield client

    @contextmanager
    def _visit(self, caller: Caller) -> Iterator[None]:
        # A client may abandon its calls, which go on.
        most = MAX_VISITS_OF_TOKEN
        if not caller.token:
            # All agents of this machine may join at the same time.
            most = max(most, self._max_games)
        if self._visits[caller.owner] >= most:
            raise RobotouilleError(
                f"{most} of your calls wait for the game server; call again later"
            )
        with counted(self._visits, caller.owner):
            yield

    async def join(
        self, caller: Caller, episode: str, seat: str | None, role: Literal["player", "spectator"]
    ) -> OpenGame:
        """Join an episode over a new connection.

        Raises:
            RobotouilleError: Too many games are open, or the game server refuses.
            ValueError: The message does not allow one of the arguments.
        """
        self._check_places(caller)
        with self._visit(caller):
            # Only a token that the game server has accepted may take a place.
            async with AsyncExitStack() as stack:
                async with waiting():
                    client = await Client(
                        self.url, name=caller.name, kind="model", token=caller.token
                    ).__aenter__()
                    stack.push_async_callback(client.close)
                with self._place(caller):
                    game = await client.join(episode, seat=seat, role=role, partial=True)
                stack.pop_all()
        handle = f"game-{secrets.token_urlsafe(12)}"
        opened = OpenGame(handle, caller.owner, client, game, caller.mcp_session)
        opened.last_used = asyncio.get_running_loop().time()
        self._games[handle] = opened
        return opened

    def plays(self, caller: Caller) -> bool:
        """Return whether a caller has games."""
        return caller.owner in self._places

    def _check_places(self, caller: Caller) -> None:
        if self._places.total() >= self._max_games:
            raise RobotouilleError(f"this program already plays {self._max_games} games")
        if caller.token and self._places[caller.owner] >= MAX_GAMES_OF_TOKEN:
            raise RobotouilleError(f"you already have {MAX_GAMES_OF_TOKEN} open games; leave one")

    @contextmanager
    def _place(self, caller: Caller) -> Iterator[None]:
        # Reserved before the join, so that parallel joins cannot exceed the limits.
        self._check_places(caller)
        self._places[caller.owner] += 1
        try:
            yield
        except BaseException:
            _uncount(self._places, caller.owner)
            raise

    @asynccontextmanager
    async def using(self, caller: Caller, handle: str | None) -> AsyncIterator[OpenGame]:
        """Open a caller's game for one call. It does not count as idle during the call.

        Raises:
            RobotouilleError: The caller has no such game, or newer calls have replaced this one.
        """
        opened = self._find(caller, handle)
        async with opened.call():
            yield opened

    def _find(self, caller: Caller, handle: str | None) -> OpenGame:
        if handle is None:
            return self._only(caller)
        opened = self._games.get(handle)
        if opened is None or not secrets.compare_digest(opened.owner, caller.owner):
            raise RobotouilleError(
                "you have no game with this handle: it was left, was closed after "
                f"{self._idle_seconds:g} s without a call, or belongs to another token; call join"
            )
        return opened

    def _only(self, caller: Caller) -> OpenGame:
        if not caller.alone:
            raise RobotouilleError("name the game: pass the handle that join returned as `game`")
        if not self._games:
            raise RobotouilleError("you are in no game; call join")
        if len(self._games) > 1:
            handles = ", ".join(f"{g.handle} ({g.game.seat})" for g in self._games.values())
            raise RobotouilleError(f"name the game with `game`: {handles}")
        return next(iter(self._games.values()))

    async def close(self, opened: OpenGame) -> None:
        """Leave a game and forget its handle."""
        if self._games.pop(opened.handle, None) is not None:
            _uncount(self._places, opened.owner)
            await opened.close()

    def sessions(self) -> set[str | None]:
        """Return the MCP sessions that have games."""
        return {opened.mcp_session for opened in self._games.values()}

    async def end_session(self, mcp_session: str, owner: str) -> None:
        """Leave an owner's games of an MCP session that has ended."""
        await self._close(
            g for g in self._games.values() if (g.mcp_session, g.owner) == (mcp_session, owner)
        )

    async def close_all(self) -> None:
        """Leave all games."""
        await self._close(self._games.values())

    async def _close(self, games: Iterable[OpenGame]) -> None:
        await asyncio.gather(*map(self.close, list(games)))

    async def _close_unused(self) -> None:
        now = asyncio.get_running_loop().time
        while True:
            await asyncio.sleep(LOOK_SECONDS)
            await self._close(g for g in self._games.values() if self._is_unused(g, now()))

    def _is_unused(self, opened: OpenGame, now: float) -> bool:
        # A client whose token is revoked must not keep its place by further calls.
        if opened.is_lost(now, LOST_SECONDS):
            return True
        return not opened.calls and opened.last_used <= now - self._idle_seconds

    @asynccontextmanager
    async def running(self) -> AsyncIterator[OpenGames]:
        """Leave idle and lost games within the context, and all games at its end."""
        keeper = asyncio.create_task(self._close_unused(), name="robotouille-mcp unused games")
        try:
            yield self
        finally:
            keeper.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await keeper
            await self.close_all()


MAX_NAME = 40
SESSION_HEADER = "mcp-session-id"


def bearer(authorization: str | None) -> str | None:
    """Return the bearer token of an `Authorization` header."""
    scheme, _, token = (authorization or "").partition(" ")
    return token.strip() or None if scheme.lower() == "bearer" else None


def caller_of(ctx: Context[OpenGames, Any], name: str | None = None) -> Caller:
    """Return the caller. Over HTTP it has its own token, otherwise that of this process."""
    games = ctx.request_context.lifespan_context
    called = (name or games.name or _client_name(ctx))[:MAX_NAME]
    if ctx.headers is None:
        return Caller(games.token, called)
    token = bearer(ctx.headers.get("authorization"))
    return Caller(token, called, alone=False, mcp_session=ctx.headers.get(SESSION_HEADER))


def _client_name(ctx: Context[OpenGames, Any]) -> str:
    params = ctx.session.client_params
    return (params.client_info.name if params is not None else "") or "mcp-agent"
