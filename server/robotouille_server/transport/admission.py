"""What a server's connections share: the loop budget, TLS handshakes, how many there may be."""

from __future__ import annotations

import asyncio
import ssl
from collections import deque
from collections.abc import Callable
from typing import Protocol

from robotouille_server.runtime.metrics import Metrics

__all__ = ["MAX_SURPLUS_CONNECTIONS", "Admission", "Handshakes", "LoopBudget"]

LOOP_BUDGET = 96.0
"""Frames that all connections together have dealt with in one turn of the event loop; what takes
longer than most counts for several."""
HANDSHAKES_AT_ONCE = 16
"""Each takes half a megabyte, and some milliseconds without a pause."""
MAX_SURPLUS_CONNECTIONS = 1000
"""Connections beyond the limit, whose handshakes say that the server is full."""
FAIR_SECONDS = 1.0
"""After which a handshake makes room, if others wait."""


class LoopBudget:
    """Who has sent something and when it is looked at: so much in each turn of the event loop,
    and those who wait one after the other. In between steps are taken."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: deque[Callable[[], None]] = deque()
        self._spent = 0.0
        self._scheduled = False

    @property
    def over(self) -> bool:
        """Whether the present turn is used up."""
        return self._spent >= LOOP_BUDGET

    @property
    def free(self) -> bool:
        """Whether something that has just come may be looked at now."""
        return not self._waiting and self._spent < LOOP_BUDGET

    def spend(self, cost: float) -> None:
        """So much of the present turn is used up."""
        self._spent += cost
        self._schedule()

    def wait(self, resume: Callable[[], None]) -> None:
        """Call back when all those who wait already have had their turn."""
        self._waiting.append(resume)
        self._schedule()

    def _schedule(self) -> None:
        if not self._scheduled:
            self._scheduled = True
            self._loop.call_soon(self._turn)

    def _turn(self) -> None:
        self._scheduled = False
        self._spent = 0.0
        for _ in range(len(self._waiting)):  # Those who wait again have their turn in the next.
            if self.over:
                break
            self._waiting.popleft()()
        if self._waiting:
            self._schedule()


class Handshakes:
    """TLS handshakes under way: few at a time, and the slowest make room where others wait."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._all: dict[asyncio.Transport, None] = {}
        self._running: dict[asyncio.Transport, float] = {}
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._looking: asyncio.TimerHandle | None = None

    async def make(
        self,
        raw: asyncio.Transport,
        protocol: asyncio.Protocol,
        tls: ssl.SSLContext,
        seconds: float,
    ) -> asyncio.Transport | None:
        """The encrypted transport; None where the handshake fails, or is not over in time."""
        self._all[raw] = None
        try:
            async with asyncio.timeout(seconds):
                await self._slot()
                self._running[raw] = self._loop.time()
                return await self._loop.start_tls(raw, protocol, tls, server_side=True)
        except (OSError, TimeoutError):  # Nobody's business.
            return None
        finally:
            del self._all[raw]
            if self._running.pop(raw, None) is not None:
                self._next()

    def close(self) -> None:
        """Make none any more."""
        for raw in list(self._all):
            raw.abort()
        for slot in self._waiting:
            slot.cancel()

    async def _slot(self) -> None:
        if len(self._running) < HANDSHAKES_AT_ONCE and not self._waiting:
            return
        slot: asyncio.Future[None] = self._loop.create_future()
        self._waiting.append(slot)
        self._look()
        try:
            await slot
        except asyncio.CancelledError:
            if slot.done() and not slot.cancelled():
                self._next()  # It was given one, and does not need it any more.
            raise

    def _next(self) -> None:
        while self._waiting and len(self._running) < HANDSHAKES_AT_ONCE:
            slot = self._waiting.popleft()
            if not slot.done():
                slot.set_result(None)
                break

    def _look(self) -> None:
        """Is one under way that has had its time?"""
        if self._looking is not None:
            self._looking.cancel()
            self._looking = None
        now = self._loop.time()
        for raw, begun in list(self._running.items()):
            if now - begun >= FAIR_SECONDS:
                raw.abort()
        if any(not slot.done() for slot in self._waiting) and self._running:
            due = min(self._running.values()) + FAIR_SECONDS
            self._looking = self._loop.call_at(max(due, now + 0.1), self._look)


class Pending(Protocol):
    """Somebody who is connected and has said nothing yet."""

    def abort(self) -> None:
        """Cut them off."""


class Admission:
    """Those who are connected, whether they have said anything or not. `limit` may be; they have
    so many seconds to say something, and with `tls` for its handshake before."""

    def __init__(self, metrics: Metrics, limit: int, opening_seconds: float) -> None:
        loop = asyncio.get_running_loop()
        self.metrics = metrics
        self.limit = limit
        self.tls: ssl.SSLContext | None = None
        self.opening_seconds = opening_seconds
        self.loop_budget = LoopBudget(loop)
        self.handshakes = Handshakes(loop)
        self.pending: set[Pending] = set()
        self.admitted = 0

    def admit(self) -> bool:
        """One more is connected, if it is not one too many."""
        if self.admitted >= self.limit:
            return False
        self.admitted += 1
        return True

    def close(self) -> None:
        """Nobody who has said nothing yet comes in any more."""
        self.handshakes.close()
        for one in list(self.pending):
            one.abort()

    def release(self) -> None:
        """One who was let in is gone."""
        self.admitted -= 1
