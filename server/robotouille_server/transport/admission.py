"""Limits that all connections share: event loop time, TLS handshakes, number of connections."""

from __future__ import annotations

import asyncio
import ssl
from collections import deque
from collections.abc import Callable
from math import inf
from typing import Protocol

from robotouille_server.runtime.metrics import Metrics

LOOP_BUDGET = 96.0
"""Frames that all connections together process in one turn of the event loop. An expensive frame
counts as several. A higher budget would delay the steps of episodes."""
TURN_SECONDS = 0.02
"""Time after which a turn ends although its budget is not used up. Some messages take far longer
than their share: a misspelt sentence is compared with all valid ones for milliseconds."""
PAUSE_SECONDS = 0.0002
"""Time between two reads after which a new turn has begun. Within a turn, the event loop calls one
connection after the other."""
HANDSHAKES_AT_ONCE = 16
"""Concurrent handshakes. Each takes half a megabyte and blocks the event loop for milliseconds."""
MAX_SURPLUS_CONNECTIONS = 1000
"""Connections accepted beyond the limit, only to answer that the server is full."""
FAIR_SECONDS = 1.0
"""Seconds after which a handshake is aborted if others wait."""


class LoopBudget:
    """Budget of work per turn of the event loop, with a fair queue for connections beyond it.

    Between two turns, the event loop takes the steps of episodes.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: deque[Callable[[], None]] = deque()
        self._spent = 0.0
        self._scheduled = False
        self._until = inf
        self._worked = -inf

    @property
    def over(self) -> bool:
        """True if the budget or the time of the current turn is used up."""
        return self._spent >= LOOP_BUDGET or self._loop.time() >= self._until

    def start(self) -> bool:
        """Return whether data that has just arrived may be processed now; then call `done`."""
        now = self._loop.time()
        # The event loop does not tell when a turn begins. A callback for each turn would cost as
        # much as reading a message, so it is used only when half of the budget is spent.
        if not self._scheduled and now - self._worked > PAUSE_SECONDS:
            self._begin(now)
        return not self._waiting and self._spent < LOOP_BUDGET and now < self._until

    def done(self) -> None:
        """Note that the data has been processed."""
        self._worked = self._loop.time()

    def spend(self, cost: float) -> None:
        """Charge work to the current turn."""
        self._spent += cost
        if self._spent >= LOOP_BUDGET / 2:
            self._schedule()

    def wait(self, resume: Callable[[], None]) -> None:
        """Call `resume` after all connections in the queue have had their turn."""
        # The queue is first come, first served, so that a flooding connection cannot overtake
        # others.
        self._waiting.append(resume)
        self._schedule()

    def _schedule(self) -> None:
        if not self._scheduled:
            self._scheduled = True
            # The queue continues in the next turn, which also handles sockets and the timers of due
            # steps.
            self._loop.call_soon(self._turn)

    def _begin(self, now: float) -> None:
        self._spent, self._until = 0.0, now + TURN_SECONDS

    def _turn(self) -> None:
        self._scheduled = False
        self._begin(self._loop.time())
        try:
            # Connections that queue again wait for the next turn.
            for _ in range(len(self._waiting)):
                # Without this break, a due step could wait for more than one budget of work.
                if self.over:
                    break
                self._waiting.popleft()()
        finally:
            # The event loop logs the error of a connection; the others must still get their turns.
            if self._waiting:
                self._schedule()
            self.done()


class Handshakes:
    """TLS handshakes: few at a time, and slow ones are aborted if others wait."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._all: dict[asyncio.Transport, None] = {}
        self._running: dict[asyncio.Transport, float] = {}
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._timer: asyncio.TimerHandle | None = None

    async def make(
        self,
        raw: asyncio.Transport,
        protocol: asyncio.BaseProtocol,
        tls: ssl.SSLContext,
        seconds: float,
    ) -> asyncio.Transport | None:
        """Return the encrypted transport; None if the handshake fails or takes too long."""
        self._all[raw] = None
        try:
            # The limit includes the time in the queue, so that waiting clients do not accumulate.
            async with asyncio.timeout(seconds):
                await self._slot()
                self._running[raw] = self._loop.time()
                return await self._loop.start_tls(raw, protocol, tls, server_side=True)
        except (OSError, TimeoutError):  # The client's fault; logging it would fill the log.
            return None
        finally:
            del self._all[raw]
            if self._running.pop(raw, None) is not None:
                self._next()

    def close(self) -> None:
        """Abort all handshakes."""
        for raw in list(self._all):
            raw.abort()
        for slot in self._waiting:
            slot.cancel()

    async def _slot(self) -> None:
        # Newcomers queue behind those who wait, even if a slot has just become free.
        if len(self._running) < HANDSHAKES_AT_ONCE and not self._waiting:
            return
        slot: asyncio.Future[None] = self._loop.create_future()
        self._waiting.append(slot)
        # Slow handshakes are tolerated until another client waits for the slot: a phone on a bad
        # network needs seconds, and an attacker could hold all slots.
        self._abort_slow()
        try:
            await slot
        except asyncio.CancelledError:
            if slot.done() and not slot.cancelled():
                self._next()  # Pass the slot on.
            raise

    def _next(self) -> None:
        while self._waiting and len(self._running) < HANDSHAKES_AT_ONCE:
            slot = self._waiting.popleft()
            if not slot.done():
                slot.set_result(None)
                break

    def _abort_slow(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        now = self._loop.time()
        for raw, begun in list(self._running.items()):
            if now - begun >= FAIR_SECONDS:
                raw.abort()
        if any(not slot.done() for slot in self._waiting) and self._running:
            due = min(self._running.values()) + FAIR_SECONDS
            # This runs at most ten times a second, however many clients wait.
            self._timer = self._loop.call_at(max(due, now + 0.1), self._abort_slow)


class Newcomer(Protocol):
    """Connection that has not completed its handshake yet."""

    def abort(self) -> None:
        """Close the connection at once."""


class Newcomers:
    """Connections that have not completed their handshake; few of each address.

    One more than `limit` replaces the oldest, so connections that send nothing do not lock out
    newcomers.

    Args:
        limit: The maximum number of connections of a group.
        group_of: Returns the group of a peer name; an empty one is not limited.
    """

    def __init__(self, limit: int, group_of: Callable[[object], str]) -> None:
        self._limit = limit
        self._group_of = group_of
        self._groups: dict[Newcomer, str] = {}
        self._members: dict[str, dict[Newcomer, None]] = {}

    def __len__(self) -> int:
        return len(self._groups)

    def enter(self, one: Newcomer, peer: object) -> Newcomer | None:
        """Add a connection; return the one that it replaces, which must be closed."""
        group = self._groups[one] = self._group_of(peer)
        if not group:
            return None
        members = self._members.setdefault(group, {})
        members[one] = None
        if len(members) <= self._limit:
            return None
        oldest = next(iter(members))
        self.leave(oldest)
        return oldest

    def leave(self, one: Newcomer) -> None:
        """Remove a connection, if it is still there."""
        group = self._groups.pop(one, "")
        if members := self._members.get(group):
            members.pop(one, None)
            if not members:
                del self._members[group]

    def close(self) -> None:
        """Close all connections."""
        for one in list(self._groups):
            one.abort()


class Admission:
    """Limits of a server's connections.

    Attributes:
        limit: The maximum number of connections.
        tls: The TLS context, if the server uses TLS.
        opening_seconds: The seconds that a client has for its TLS handshake, and again for its
            request.
        newcomers: The connections that have not completed their handshake yet.
        admitted: The number of connections.
    """

    def __init__(
        self, metrics: Metrics, limit: int, opening_seconds: float, newcomers: Newcomers
    ) -> None:
        loop = asyncio.get_running_loop()
        self.metrics = metrics
        self.limit = limit
        self.tls: ssl.SSLContext | None = None
        self.opening_seconds = opening_seconds
        self.loop_budget = LoopBudget(loop)
        self.handshakes = Handshakes(loop)
        self.newcomers = newcomers
        self.admitted = 0
        self._empty: asyncio.Future[None] | None = None

    def admit(self) -> bool:
        """Count a new connection; return False if there are too many."""
        # Connections count from `accept`, not from the end of the handshake, because connections
        # that send nothing need descriptors and memory, too.
        if self.admitted >= self.limit:
            return False
        self.admitted += 1
        return True

    def enter(self, one: Newcomer, peer: object) -> None:
        """Add a connection that has not completed its handshake."""
        displaced = self.newcomers.enter(one, peer)
        if displaced is not None:
            self.metrics.dropped.labels("displaced").inc()
            displaced.abort()

    def close(self) -> None:
        """Close all connections that have not completed their handshake."""
        self.handshakes.close()
        self.newcomers.close()

    def release(self) -> None:
        """Count a connection as closed."""
        self.admitted -= 1
        if self._empty is not None and self.admitted == 0 and not self._empty.done():
            self._empty.set_result(None)

    async def wait_empty(self) -> None:
        """Wait until all connections are closed."""
        if self.admitted:
            self._empty = asyncio.get_running_loop().create_future()
            await self._empty
