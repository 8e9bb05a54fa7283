"""Turns of requests over HTTP: the event loop serves one request of each token after the other."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from contextvars import ContextVar

TURNS_AT_ONCE = 1
"""Turns of all tokens at the same time.

A request takes about 3 ms of the event loop in up to 30 passes. Others that are served at the same
time would do a part of their work in each of these passes.
"""
TURN_SECONDS = 0.05
"""Longest time of a turn. A request that is never answered, such as one with the id of another one
in progress, would otherwise keep its place."""


class Turns:
    """The turns of all requests.

    Tokens take turns, and the requests of a token begin in order of arrival. A request therefore
    waits for one request of each other token, however many they send. In one pass of the event
    loop, only one request begins. Refusals take no time between their beginning and end, so the
    number of places alone would let hundreds of them pass at once.
    """

    def __init__(self) -> None:
        self._free = TURNS_AT_ONCE
        self._rests = False
        # The waiting requests of each token. The first token is next.
        self._waiting: dict[str, deque[asyncio.Future[None]]] = {}

    async def enter(self, key: str) -> None:
        """Wait for a place."""
        own = asyncio.get_running_loop().create_future()
        self._waiting.setdefault(key, deque()).append(own)
        self._admit()
        try:
            await own
        except asyncio.CancelledError:
            if own.done() and not own.cancelled():
                self.leave()
            raise

    def leave(self) -> None:
        """Free a place."""
        self._free += 1
        self._admit()

    @asynccontextmanager
    async def turn(self, key: str) -> AsyncIterator[Turn]:
        """Wait for a turn of the requests with this key. It ends with the context."""
        turn = Turn(self, key)
        await turn.begin()
        current = _TURN.set(turn)
        try:
            yield turn
        finally:
            _TURN.reset(current)
            turn.end()

    def _admit(self) -> None:
        if self._free and not self._rests and (own := self._next()):
            self._free -= 1
            own.set_result(None)
            self._rests = True
            asyncio.get_running_loop().call_soon(self._admit_again)

    def _admit_again(self) -> None:
        self._rests = False
        self._admit()

    def _next(self) -> asyncio.Future[None] | None:
        """Take the first request of the next token, whose other requests then come last."""
        while self._waiting:
            key = next(iter(self._waiting))
            requests = self._waiting.pop(key)
            while requests and requests[0].cancelled():
                requests.popleft()
            if requests:
                first = requests.popleft()
                if requests:
                    self._waiting[key] = requests
                return first
        return None


class Turn:
    """The turn of one request."""

    def __init__(self, turns: Turns, key: str) -> None:
        self._turns = turns
        self._key = key
        self._latest_end: asyncio.TimerHandle | None = None

    async def begin(self) -> None:
        """Wait for a place."""
        await self._turns.enter(self._key)
        self._latest_end = asyncio.get_running_loop().call_later(TURN_SECONDS, self.end)

    def end(self) -> None:
        """Leave the place to the next request, unless the turn has ended already."""
        if self._latest_end is not None:
            self._latest_end.cancel()
            self._latest_end = None
            self._turns.leave()


_TURN: ContextVar[Turn | None] = ContextVar("turn", default=None)
"""The turn of the request that is being served. The MCP library runs the tool of a call in the
call's context, also after the client has closed its connection."""


@asynccontextmanager
async def waiting() -> AsyncIterator[None]:
    """Leave the place of the current call to others within the context, and wait for a new one."""
    turn = _TURN.get()
    if turn is not None:
        turn.end()
    yield
    if turn is not None:
        await turn.begin()


def end_turn() -> None:
    """End the turn of the current call, whose client may be gone."""
    if turn := _TURN.get():
        turn.end()
