"""Limits that all connections share: TLS handshakes, number of connections."""

from __future__ import annotations

import asyncio
import ssl
from collections import deque
from collections.abc import Callable
from typing import Protocol

from robotouille_server.runtime.metrics import Metrics
from robotouille_server.transport.loop_budget import LoopBudget
from robotouille_server.transport.tls import ServerTLS
from robotouille_server.transport.tls_records import ClientHello, start_metered_tls

SILENT_FACTOR = 8
"""Limit of connections without a byte, as a multiple of that of other connections of an address.
They need little memory: a client's address is shared by strangers, who must not displace the client
within its round trip."""
HANDSHAKES_AT_ONCE = 64
"""Concurrent handshakes. Each takes about 50 KiB, used or not."""
MAX_SURPLUS_CONNECTIONS = 1000
"""Connections accepted beyond the limit, only to answer that the server is full."""
FAIR_SECONDS = 1.0
"""Seconds after which a handshake is aborted if others wait."""


class Handshakes:
    """TLS handshakes: few at a time, and slow ones are aborted if others wait.

    Args:
        budget: Charged for all TLS records, during and after the handshakes.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, budget: LoopBudget) -> None:
        self._loop = loop
        self._budget = budget
        self._all: dict[asyncio.Transport, None] = {}
        self._running: dict[asyncio.Transport, float] = {}
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._timer: asyncio.TimerHandle | None = None

    async def make(
        self,
        client: ClientHello,
        protocol: asyncio.BaseProtocol,
        tls: ssl.SSLContext,
        seconds: float,
    ) -> asyncio.Transport | None:
        """Return the encrypted transport; None if the handshake fails or takes too long.

        Args:
            client: The transport of the socket, and the handshake's first bytes.
            protocol: Receives data that arrives together with the end of the handshake.
            seconds: Time limit.
        """
        raw = client.raw
        self._all[raw] = None
        try:
            # The limit includes the time in the queue, so that waiting clients do not accumulate.
            async with asyncio.timeout(seconds):
                await self._slot()
                self._running[raw] = self._loop.time()
                return await start_metered_tls(client, protocol, tls, self._budget, seconds)
        except (OSError, TimeoutError) as error:  # The client's fault. Logging would fill the log.
            # The traceback refers to the future in `start_tls`, and the future to the error. Such
            # cycles would keep the TLS of failed handshakes until a garbage collection.
            error.__traceback__ = None
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

    One more than the limit replaces the oldest, so connections that send nothing do not lock out
    newcomers. Connections that have sent nothing have a limit of their own. Opening one costs
    almost nothing, so they never replace those that have sent data.

    Args:
        limit: The maximum number of connections of a group that have sent data.
        silent_limit: The maximum number of connections of a group that have sent nothing.
        group_of: Returns the group of a peer name; an empty one is not limited.
    """

    def __init__(self, limit: int, silent_limit: int, group_of: Callable[[object], str]) -> None:
        self._limits = {True: limit, False: silent_limit}
        self._group_of = group_of
        self._groups: dict[Newcomer, tuple[str, bool]] = {}
        self._members: dict[tuple[str, bool], dict[Newcomer, None]] = {}

    def __len__(self) -> int:
        return len(self._groups)

    def enter(self, one: Newcomer, peer: object, *, heard: bool) -> Newcomer | None:
        """Add a connection; return the one that it replaces, which must be closed.

        Args:
            heard: True if the connection has sent data. A connection enters again when it has.
        """
        self.leave(one)
        name = self._group_of(peer)
        group = self._groups[one] = (name, heard)
        if not name:
            return None
        members = self._members.setdefault(group, {})
        members[one] = None
        if len(members) <= self._limits[heard]:
            return None
        oldest = next(iter(members))
        self.leave(oldest)
        return oldest

    def leave(self, one: Newcomer) -> None:
        """Remove a connection, if it is still there."""
        group = self._groups.pop(one, None)
        members = self._members.get(group) if group is not None else None
        if group is not None and members:
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
        tls: The certificate, if the server uses TLS.
        opening_seconds: The seconds that a client has for its first byte, again for its TLS
            handshake, and again for its request.
        newcomers: The connections that have not completed their handshake yet.
        turn_group_of: Returns the group with which a peer name shares turns before its request;
            None for turns of its own.
        admitted: The number of connections.
    """

    def __init__(
        self,
        metrics: Metrics,
        limit: int,
        opening_seconds: float,
        newcomers: Newcomers,
        turn_group_of: Callable[[object], str | None],
    ) -> None:
        loop = asyncio.get_running_loop()
        self.metrics = metrics
        self.limit = limit
        self.tls: ServerTLS | None = None
        self.opening_seconds = opening_seconds
        self.loop_budget = LoopBudget(loop)
        self.handshakes = Handshakes(loop, self.loop_budget)
        self.newcomers = newcomers
        self.turn_group_of = turn_group_of
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

    def enter(self, one: Newcomer, peer: object, *, heard: bool) -> None:
        """Add a connection that has not completed its handshake; see `Newcomers.enter`."""
        displaced = self.newcomers.enter(one, peer, heard=heard)
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
