"""TLS records of a connection, decrypted a few at a time.

OpenSSL decrypts everything that it has received in one call. A record of 23 bytes can contain one
byte or a change of keys (RFC 8446, section 4.6.3), which costs as much as a message. So a client
could stop the event loop with a small stream of records. `RecordMeter` therefore stands between the
socket and the TLS of asyncio. It passes on whole records, and charges them to the loop's budget.
"""

from __future__ import annotations

import asyncio
import ssl
from asyncio.sslproto import SSLProtocol
from typing import Any, NamedTuple, cast

from robotouille_server.transport.loop_budget import LoopBudget

HEAD_BYTES = 5
"""Size of a record's head: type, version and length (RFC 8446, section 5.1)."""
HANDSHAKE = 22
"""Type of the records in which clients begin a handshake, in all versions."""
RECORDS_AT_A_TIME, BYTES_AT_A_TIME = 16, 16 * 1024
"""Records of one connection, and bytes, after which all others get a turn."""
MAX_HANDSHAKE_BYTES = 8 * 1024
"""Size of all records of a client's handshakes, above which it is disconnected. OpenSSL compares
each key share of a ClientHello with each group: 64 KiB of them take it 75 ms."""
RECORD_COST = 2.0
"""Cost of a record, in frames. A change of keys takes about 50 microseconds."""
HANDSHAKE_COST = 48.0
"""Cost of a record of a handshake. A signature with an RSA key of 4,096 bits takes milliseconds."""

TLS_BUFFER_BYTES = 20 * 1024
"""Bytes passed to TLS at a time. The largest record has 18 KiB and a head (RFC 5246, 6.2.3)."""

# Each encrypted connection of asyncio holds a buffer of this size, by default 256 KiB. That is the
# most that asyncio reads from a socket at a time, but the meter passes on less. No argument of
# `start_tls` changes the size, so it is changed for all connections of the process.
SSLProtocol.max_size = TLS_BUFFER_BYTES

METER = "record_meter"
"""Key under which `get_extra_info` of an encrypted transport returns its `RecordMeter`."""

ENCRYPTED_BUFFER = memoryview(bytearray(2 * BYTES_AT_A_TIME))
"""Buffer that all encrypted sockets are read into, one after the other."""


class ClientHello(NamedTuple):
    """Beginning of a client's TLS handshake.

    Attributes:
        raw: The transport of the socket. Its reading must be paused.
        first: The bytes that have been read already.
        group: The clients with which this one shares its turns; None if it has its own.
    """

    raw: asyncio.Transport
    first: bytes = b""
    group: str | None = None


async def start_metered_tls(
    client: ClientHello,
    protocol: asyncio.BaseProtocol,
    context: ssl.SSLContext,
    budget: LoopBudget,
    seconds: float,
) -> asyncio.Transport:
    """Make the server's part of a TLS handshake, and return the encrypted transport.

    Args:
        client: The transport of the socket, and the handshake's first bytes.
        protocol: Receives data, which may arrive before this function returns.
        budget: Charged for all records, during and after the handshake.
        seconds: Time limit.

    Raises:
        OSError: The handshake failed, or took too long.
    """
    # asyncio would connect TLS to a lost transport, and nothing would ever end it.
    if client.raw.is_closing():
        raise ConnectionAbortedError("the connection was aborted before the handshake")
    encrypted = await asyncio.get_running_loop().start_tls(
        RecordMeter(client.raw, budget, received=client.first, group=client.group),
        protocol,
        context,
        server_side=True,
        ssl_handshake_timeout=seconds,
    )
    if encrypted is None:  # The connection was aborted; asyncio reports no error then.
        raise ConnectionAbortedError("the connection was aborted in the handshake")
    # While the protocol reads nothing, records wait in the meter.
    cast("Any", encrypted).set_read_buffer_limits(high=1)
    return encrypted


class RecordMeter(asyncio.Transport, asyncio.BufferedProtocol):
    """Transport for `loop.start_tls` that passes on few records in a turn of the event loop.

    It is also the protocol of the socket's transport.

    Args:
        raw: The transport of the socket. Its reading must be paused.
        budget: Charged for each record.
        max_handshake: Size of all records of handshakes, above which the connection is aborted.
        received: Bytes that have been read from the socket already.
        group: The clients with which this one shares its turns; None if it has its own.

    Attributes:
        group: As above. It may change, for example when the client has shown a token.
    """

    # The event loop and its TLS use this attribute and `_force_close` of any transport below TLS.
    _start_tls_compatible = True

    def __init__(
        self,
        raw: asyncio.Transport,
        budget: LoopBudget,
        max_handshake: float = MAX_HANDSHAKE_BYTES,
        received: bytes = b"",
        group: str | None = None,
    ) -> None:
        super().__init__()
        self.group = group
        self._max_handshake = max_handshake
        self._raw = raw
        self._budget = budget
        self._protocol: asyncio.BufferedProtocol | None = None
        self._received = bytearray(received)
        self._handshake_bytes = 0
        self._at_end = False
        # Three reasons to hold records back: TLS takes no more, the client does not read, and
        # records wait for their turn.
        self._paused = True
        self._unread = self._queued = False
        self._holds_back = True
        raw.set_protocol(self)

    # Records

    def get_buffer(self, sizehint: int) -> memoryview:
        return ENCRYPTED_BUFFER

    def buffer_updated(self, nbytes: int) -> None:
        self._received += ENCRYPTED_BUFFER[:nbytes]
        if not self._queued and not self._paused and not self._unread and self._budget.start():
            self._pass_on()
            self._budget.done()
        else:
            self._wait()

    def eof_received(self) -> bool | None:
        self._at_end = True
        if self._next_records()[0]:
            return True  # Records wait for their turn. The end follows them.
        self._end()
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        protocol, self._protocol = self._protocol, None
        self._received.clear()
        if protocol is not None:
            protocol.connection_lost(exc)

    def _next_records(self) -> tuple[int, float]:
        """Return the size and cost of the records to pass on next; 0 if there is no whole one."""
        received, size, cost = self._received, 0, 0.0
        for _ in range(RECORDS_AT_A_TIME):
            if len(received) - size < HEAD_BYTES:
                break
            # A record of a handshake is passed on alone, because each may take milliseconds.
            if size and received[size] == HANDSHAKE:
                break
            length = int.from_bytes(received[size + 3 : size + HEAD_BYTES], "big")
            # OpenSSL rejects records of more than 18 KiB by their head. It needs no more of them.
            end = size + HEAD_BYTES + min(length, TLS_BUFFER_BYTES - HEAD_BYTES)
            if len(received) < end or (size and end > TLS_BUFFER_BYTES):
                break
            cost += HANDSHAKE_COST if received[size] == HANDSHAKE else RECORD_COST
            size = end
            if size >= BYTES_AT_A_TIME or cost >= HANDSHAKE_COST:
                break
        return size, cost

    def _wait(self) -> None:
        """Pass on the next records in a later turn, if there are any and TLS takes them."""
        if not self._queued and self._next_records()[0]:
            self._queued = True
            self._budget.wait(self._take_turn, self.group)
        self._control_reading()

    def _take_turn(self) -> None:
        self._queued = False
        if not self._paused and not self._unread:
            self._pass_on()

    def _pass_on(self) -> None:
        size, cost = self._next_records()
        if self._protocol is None or not size:
            return
        self._budget.spend(cost)
        if self._received[0] == HANDSHAKE:
            self._handshake_bytes += size
            if self._handshake_bytes > self._max_handshake:
                self._raw.abort()
                return
        records = self._received[:size]
        del self._received[:size]
        memoryview(self._protocol.get_buffer(size))[:size] = records
        self._protocol.buffer_updated(size)
        self._wait()
        if self._at_end and not self._queued:
            self._end()

    def _end(self) -> None:
        if self._protocol is not None and not self._protocol.eof_received():
            self._raw.close()

    def _control_reading(self) -> None:
        """Read from the socket only if everything that has arrived could be passed on."""
        # Unread data stays in the kernel's buffers, and TCP slows down the sender.
        holds_back = self._paused or self._unread or self._queued
        if holds_back == self._holds_back or self._at_end or self._raw.is_closing():
            return
        self._holds_back = holds_back
        if holds_back:
            self._raw.pause_reading()
        else:
            self._raw.resume_reading()

    # Flow control

    def pause_reading(self) -> None:
        self._paused = True
        self._control_reading()

    def resume_reading(self) -> None:
        self._paused = False
        self._wait()

    def is_reading(self) -> bool:
        return not self._paused

    def pause_writing(self) -> None:
        # Some records are answered by TLS itself, so a client that sends and never reads would fill
        # the memory.
        self._unread = True
        if self._protocol is not None:
            self._protocol.pause_writing()
        self._control_reading()

    def resume_writing(self) -> None:
        self._unread = False
        if self._protocol is not None:
            self._protocol.resume_writing()
        self._wait()

    # Everything else is left to the socket's transport.

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        if not isinstance(protocol, asyncio.BufferedProtocol):
            raise TypeError("TLS must be a buffered protocol")
        self._protocol = protocol

    def get_protocol(self) -> asyncio.BaseProtocol:
        if self._protocol is None:
            raise RuntimeError("the connection is lost")
        return self._protocol

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        return self if name == METER else self._raw.get_extra_info(name, default)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self._raw.write(data)

    def get_write_buffer_size(self) -> int:
        return self._raw.get_write_buffer_size()

    def is_closing(self) -> bool:
        return self._raw.is_closing()

    def close(self) -> None:
        self._raw.close()

    def abort(self) -> None:
        self._raw.abort()

    def _force_close(self, exc: BaseException | None) -> None:
        self._raw.abort()
