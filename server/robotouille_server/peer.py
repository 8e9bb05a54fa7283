"""One WebSocket as the rooms see it: send without waiting, never queue without bound."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from pydantic import BaseModel
from websockets.asyncio.connection import broadcast
from websockets.asyncio.server import ServerConnection
from websockets.protocol import State as Connected

from robotouille.protocol.codec import Codec
from robotouille_server.metrics import Metrics

__all__ = ["Peer"]

MAX_UNSENT = 128 * 1024
MAX_HELD = 1024 * 1024


class Peer:
    """A connection and how far it is behind.

    A client that does not read fills its write buffer; from `MAX_UNSENT` bytes on it gets no more
    deltas, and a snapshot instead once it has caught up. After `stall_seconds`, or with more than
    `MAX_HELD` bytes of anything waiting, it is dropped.
    """

    def __init__(
        self, socket: ServerConnection, codec: Codec, metrics: Metrics, stall_seconds: float
    ) -> None:
        self.socket = socket
        self.codec = codec
        self._catching_up: asyncio.Task[None] | None = None
        self._parting: asyncio.Task[None] | None = None
        self._metrics = metrics
        self._stall_seconds = stall_seconds

    @property
    def open(self) -> bool:
        return self.socket.state is Connected.OPEN

    @property
    def unsent(self) -> int:
        """Bytes that wait to be taken by the network."""
        size: int = self.socket.transport.get_write_buffer_size()
        return size

    def send(self, message: BaseModel) -> None:
        """Send a message now; dropped silently once the connection is closing."""
        self.send_payload(self.codec.encode(message))

    def send_payload(self, payload: bytes | str) -> None:
        if self.open and self.unsent > MAX_HELD:
            self.drop("stalled")
        elif self.open:
            self._metrics.sent_bytes.inc(len(payload))
            broadcast([self.socket], payload)

    def keeps_up(self, catch_up: Callable[[], None]) -> bool:
        """Whether the client may be sent deltas.

        Once it has fallen behind it is not, until it has read what it had; `catch_up` is called
        then. One that does not read in time is cut off.
        """
        if self._catching_up is None and self.unsent > MAX_UNSENT:
            self._catching_up = asyncio.create_task(self._wait_and_catch_up(catch_up))
        return self._catching_up is None

    async def _wait_and_catch_up(self, catch_up: Callable[[], None]) -> None:
        if await self._unsent_at_most(0):
            self._catching_up = None
            self._metrics.snapshots.inc()
            catch_up()

    def part(self, reason: str) -> None:
        """Close the connection politely, without waiting for the peer."""
        self._parting = asyncio.create_task(self.socket.close(1008, reason))

    def drop(self, reason: str) -> None:
        """Cut the connection off without waiting for the peer."""
        self._metrics.dropped.labels(reason).inc()
        self.socket.transport.abort()

    async def drained(self) -> bool:
        """Wait until the client has read what it was sent; False if it does not in time."""
        return self.unsent <= MAX_UNSENT or await self._unsent_at_most(MAX_UNSENT)

    async def _unsent_at_most(self, size: int) -> bool:
        loop = asyncio.get_running_loop()
        deadline = loop.time() + self._stall_seconds
        while self.open and self.unsent > size:
            if loop.time() > deadline:
                self.drop("stalled")
                return False
            await asyncio.sleep(0.05)
        return self.open
