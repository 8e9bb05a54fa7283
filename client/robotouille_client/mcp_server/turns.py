"""Turns of requests over HTTP: the event loop serves the requests of each token one by one."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from contextvars import ContextVar
from weakref import WeakValueDictionary

TURNS_AT_ONCE = 4
"""Turns of a token at the same time.

A request takes about 3 ms of the event loop, in pieces between those of other requests. It
therefore takes up to 3 ms longer for each request that is served at the same time.
"""
TURN_SECONDS = 1.0
"""Longest time of a turn. A request that is never answered, such as one with the id of another one
in progress, would otherwise keep its place."""


class _Lane:
    """The requests of one token, which begin in order of arrival.

    In one pass of the event loop, only one of them begins. Refusals take no time between their
    beginning and end, so the number of places alone would let hundreds of them pass at once.
    """

    def __init__(self) -> None:
        self._free = TURNS_AT_ONCE
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._rests = False

    async def enter(self) -> None:
        """Wait for a place."""
        loop = asyncio.get_running_loop()
        own = loop.create_future()
        self._waiting.append(own)
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

    def _admit(self) -> None:
        while self._waiting and self._waiting[0].cancelled():
            self._waiting.popleft()
        if self._waiting and self._free and not self._rests:
            self._free -= 1
            self._waiting.popleft().set_result(None)
            self._rests = True
            asyncio.get_running_loop().call_soon(self._admit_again)

    def _admit_again(self) -> None:
        self._rests = False
        self._admit()


class Turn:
    """The turn of one request."""

    def __init__(self, lane: _Lane) -> None:
        self._lane = lane
        self._latest_end: asyncio.TimerHandle | None = None

    async def begin(self) -> None:
        """Wait for a place."""
        await self._lane.enter()
        self._latest_end = asyncio.get_running_loop().call_later(TURN_SECONDS, self.end)

    def end(self) -> None:
        """Leave the place to the next request, unless the turn has ended already."""
        if self._latest_end is not None:
            self._latest_end.cancel()
            self._latest_end = None
            self._lane.leave()


class Turns:
    """The turns of all requests."""

    def __init__(self) -> None:
        # Anybody can make up tokens, so lanes without requests must not accumulate.
        self._lanes: WeakValueDictionary[str, _Lane] = WeakValueDictionary()

    @asynccontextmanager
    async def turn(self, key: str) -> AsyncIterator[Turn]:
        """Wait for a turn among the requests with the same key. It ends with the context."""
        lane = self._lanes.get(key)
        if lane is None:
            lane = self._lanes[key] = _Lane()
        turn = Turn(lane)
        await turn.begin()
        current = _TURN.set(turn)
        try:
            yield turn
        finally:
            _TURN.reset(current)
            turn.end()


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
