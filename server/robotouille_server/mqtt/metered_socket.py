"""Socket between a blocking TLS library and its peer that passes on few TLS records at a time.

paho reads from a TLS socket of Python. One read decrypts everything that has arrived, and goes on
while more arrives, so a hostile broker could hold the event loop for ever with changes of keys.
paho therefore gets one end of a pair of sockets. The event loop moves bytes between the other end
and the broker, through the meter that also serves the server's own TLS (docs/decisions/0045).
"""

from __future__ import annotations

import asyncio
import socket
from math import inf
from typing import cast

from robotouille_server.transport import LoopBudget
from robotouille_server.transport.tls_records import ENCRYPTED_BUFFER, RecordMeter

CLOSE_SECONDS = 2.0
"""Seconds that the broker has to read the rest before its connection is aborted."""
PAIR_BYTES = 4096
"""Bytes that wait between the meter and paho. All of them may be changes of keys."""


def metered(
    broker: socket.socket, loop: asyncio.AbstractEventLoop, budget: LoopBudget
) -> socket.socket:
    """Return a socket in place of a connected one, for a thread that does not run the loop.

    Args:
        broker: The connected socket, which the event loop takes over.
        loop: The event loop, which runs in another thread.
        budget: Charged for each TLS record from the broker.
    """
    near, far = socket.socketpair()
    for end in (near, far):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, PAIR_BYTES)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, PAIR_BYTES)
    for one in (broker, far):
        one.setblocking(False)
    asyncio.run_coroutine_threadsafe(_connect(broker, far, budget), loop)
    return near


async def _connect(broker: socket.socket, far: socket.socket, budget: LoopBudget) -> None:
    loop = asyncio.get_running_loop()
    try:
        raw, _ = await loop.create_connection(asyncio.Protocol, sock=broker)
        raw.pause_reading()
        # The broker's certificates may be long. The thread that connects checks them.
        meter = RecordMeter(raw, budget, max_handshake=inf)
        await loop.create_connection(lambda: _FarEnd(meter), sock=far)
    except BaseException:
        # paho learns of the failure by the end of its socket.
        for end in (broker, far):
            end.close()
        raise


class _FarEnd(asyncio.Protocol):
    """Protocol of the pair's far end: what paho sends goes to the broker."""

    def __init__(self, meter: RecordMeter) -> None:
        self._meter = meter

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        far = cast("asyncio.Transport", transport)
        # Whatever does not fit into the pair stays with the broker.
        far.set_write_buffer_limits(high=0)
        self._meter.set_protocol(_FromBroker(far))
        self._meter.resume_reading()

    def data_received(self, data: bytes) -> None:
        self._meter.write(data)

    def pause_writing(self) -> None:
        self._meter.pause_reading()

    def resume_writing(self) -> None:
        self._meter.resume_reading()

    def connection_lost(self, exc: Exception | None) -> None:
        self._meter.close()
        # A broker that does not read would keep the socket and what it has not read.
        asyncio.get_running_loop().call_later(CLOSE_SECONDS, self._meter.abort)


class _FromBroker(asyncio.BufferedProtocol):
    """Protocol above the meter: records from the broker go to paho."""

    def __init__(self, far: asyncio.Transport) -> None:
        self._far = far
        self._buffer = memoryview(bytearray(len(ENCRYPTED_BUFFER)))

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        self._far.write(bytes(self._buffer[:nbytes]))

    def connection_lost(self, exc: Exception | None) -> None:
        self._far.close()

    # paho notices a broker that does not read by packets that it cannot send.
    def pause_writing(self) -> None:
        self._far.pause_reading()

    def resume_writing(self) -> None:
        self._far.resume_reading()
