"""All games that the clients of this process play, and who may use which."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import secrets
from collections import Counter
from collections.abc import AsyncIterator, Iterable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from typing import Literal

from robotouille.errors import RobotouilleError
from robotouille_client.client import Client, connect
from robotouille_client.mcp_server.open_game import OpenGame

__all__ = ["MAX_GAMES_OF_ONE", "Caller", "OpenGames"]

MAX_GAMES_OF_ONE = 16
"""Games that one token may have open."""


@dataclass(frozen=True, slots=True)
class Caller:
    """Who calls a tool.

    `alone`: this process serves nobody else. `mcp_session` is the caller's session of the Model
    Context Protocol, in those of its versions that have any.
    """

    token: str | None = field(default=None, repr=False)
    name: str = "mcp-agent"
    alone: bool = True
    mcp_session: str | None = None

    @property
    def owner(self) -> str:
        """Callers with the same token are one; so are all without."""
        return hashlib.sha256(self.token.encode()).hexdigest() if self.token else ""


class OpenGames:
    """The open games by their handles; kept while `running`.

    A handle is a secret of whoever joined, and good with the same token only. `token` and `name`
    are for callers that bring none of their own.
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

    def __len__(self) -> int:
        return len(self._games)

    @asynccontextmanager
    async def visit(self, caller: Caller) -> AsyncIterator[Client]:
        """A connection to the game server for as long as a request takes."""
        async with connect(
            self.url, name=caller.name, kind="model", token=caller.token, reconnect=False
        ) as client:
            yield client

    async def join(
        self, caller: Caller, episode: str, seat: str | None, role: Literal["player", "spectator"]
    ) -> OpenGame:
        """Enter an episode over a new connection.

        Raises:
            RobotouilleError: There are too many games, or the game server refuses.
            ValueError: An argument is none that a message can have.
        """
        with self._place(caller):
            client = await Client(
                self.url, name=caller.name, kind="model", token=caller.token
            ).__aenter__()
            try:
                game = await client.join(episode, seat=seat, role=role)
            except BaseException:
                await client.close()
                raise
            handle = f"game-{secrets.token_urlsafe(12)}"
            opened = OpenGame(handle, caller.owner, client, game, caller.mcp_session)
            opened.last_used = asyncio.get_running_loop().time()
            self._games[handle] = opened
            return opened

    @contextmanager
    def _place(self, caller: Caller) -> Iterator[None]:
        """A place for one more game; it is kept if that is opened."""
        if self._places.total() >= self._max_games:
            raise RobotouilleError(f"this program plays {self._max_games} games already")
        if caller.token and self._places[caller.owner] >= MAX_GAMES_OF_ONE:
            raise RobotouilleError(f"you have {MAX_GAMES_OF_ONE} open games already; leave one")
        self._places[caller.owner] += 1
        try:
            yield
        except BaseException:
            self._free_place(caller.owner)
            raise

    def _free_place(self, owner: str) -> None:
        """One game less; an owner without any is forgotten, since anybody can make up tokens."""
        self._places[owner] -= 1
        if not self._places[owner]:
            del self._places[owner]

    @contextmanager
    def using(self, caller: Caller, handle: str | None) -> Iterator[OpenGame]:
        """A caller's game, which does not count as idle meanwhile.

        Raises:
            RobotouilleError: It has no such game.
        """
        opened = self._find(caller, handle)
        opened.calls += 1
        try:
            yield opened
        finally:
            opened.calls -= 1
            opened.last_used = asyncio.get_running_loop().time()

    def _find(self, caller: Caller, handle: str | None) -> OpenGame:
        if handle is None:
            return self._only(caller)
        opened = self._games.get(handle)
        if opened is None or not secrets.compare_digest(opened.owner, caller.owner):
            raise RobotouilleError(
                "you have no game with this handle: it was left, it was closed after "
                f"{self._idle_seconds:g} s without a call, or it was joined with another token; "
                "call join"
            )
        return opened

    def _only(self, caller: Caller) -> OpenGame:
        """The game of the only client, if it has one only."""
        if not caller.alone:
            raise RobotouilleError("say which game: give the handle that join returned as `game`")
        if not self._games:
            raise RobotouilleError("you are in no game; call join")
        if len(self._games) > 1:
            handles = ", ".join(f"{g.handle} ({g.game.seat})" for g in self._games.values())
            raise RobotouilleError(f"say which game, as `game`: {handles}")
        return next(iter(self._games.values()))

    async def close(self, opened: OpenGame) -> None:
        """Leave a game; its handle is worth nothing from now on."""
        if self._games.pop(opened.handle, None) is not None:
            self._free_place(opened.owner)
            await opened.close()

    async def end_session(self, mcp_session: str) -> None:
        """Leave what was joined in a session of the Model Context Protocol that has ended."""
        await self._close(g for g in self._games.values() if g.mcp_session == mcp_session)

    async def close_all(self) -> None:
        """Leave all games."""
        await self._close(self._games.values())

    async def _close(self, games: Iterable[OpenGame]) -> None:
        await asyncio.gather(*map(self.close, list(games)))

    async def _close_idle(self) -> None:
        """Leave what nobody has used for a while, for as long as this process runs."""
        loop = asyncio.get_running_loop()
        while True:
            unused = [g.last_used for g in self._games.values() if not g.calls]
            oldest = min(unused, default=loop.time())
            await asyncio.sleep(max(1.0, oldest + self._idle_seconds - loop.time()))
            long_ago = loop.time() - self._idle_seconds
            await self._close(
                g for g in self._games.values() if not g.calls and g.last_used <= long_ago
            )

    @asynccontextmanager
    async def running(self) -> AsyncIterator[OpenGames]:
        """Look after the games; all are left at the end."""
        keeper = asyncio.create_task(self._close_idle(), name="robotouille-mcp idle games")
        try:
            yield self
        finally:
            keeper.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await keeper
            await self.close_all()
