"""TCP connections in memory: two transports, and links that delay, stall, lose and mangle.

Bytes arrive in order within a connection, as with TCP, unless the link has a `Mangler`, which
drops, repeats and delays whole WebSocket messages.
"""

from __future__ import annotations

import asyncio
import errno
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

from tests.programs.simulation.frames import FrameSplitter, Unit
from tests.programs.simulation.loop import Process

if TYPE_CHECKING:
    from tests.programs.simulation.network import Network

__all__ = ["Conditions", "Connection", "Mangler", "Transport"]


class Mangler(Protocol):
    """Rule for the messages on a bad link."""

    def treat(self, unit: Unit) -> list[float]:
        """Return the extra delays of a message: none if it is lost, two if it is doubled.

        Later messages can overtake a message with an extra delay.
        """


class Conditions:
    """Quality of the connections: latency and jitter in seconds, and buffer sizes in bytes."""

    def __init__(self, latency: float = 0.01, jitter: float = 0.0, window: int = 65536) -> None:
        self.latency = latency
        self.jitter = jitter
        self.window = window


SOONEST = 1e-9
"""Seconds between two units, because timers of the same time have no order."""


class Pipe:
    """One direction of a connection."""

    def __init__(self, connection: Connection, towards_server: bool) -> None:
        self.connection = connection
        self.towards_server = towards_server
        self.mangler: Mangler | None = None
        self.stalled = False
        self.gone = False
        self.unread = 0
        self.sender: Transport
        self.receiver: Transport
        self._splitter = FrameSplitter()
        self._last = 0.0
        self._cut = False
        self._waiting: deque[tuple[Callable[..., None], tuple[Any, ...]]] = deque()

    @property
    def unsent(self) -> int:
        """Return the number of bytes that the network has not taken yet."""
        return max(0, self.unread - self.connection.network.conditions.window)

    def open(self, accept: Callable[..., None], *values: Any) -> None:
        """Send the first packet, with which the receiver accepts the connection."""
        self._send(accept, *values)

    def push(self, data: bytes) -> None:
        for unit in self._splitter.feed(data):
            self.unread += len(unit.data)
            if self.mangler is None or self._cut:
                self._send(self._data, unit)
                continue
            delays = self.mangler.treat(unit)
            if not delays:
                self.unread -= len(unit.data)
            for copy, extra in enumerate(delays):
                self.unread += len(unit.data) if copy else 0
                self._send(self._data, unit, extra=extra)

    def finish(self) -> None:
        """Send the end of the stream."""
        self._send(self._end)

    def reset(self) -> None:
        """Break the connection for the receiver and discard everything in transit."""
        if not self._cut:
            self._cut = True
            self._waiting.clear()
            self._send(self._break)

    def stall(self) -> None:
        """Deliver nothing until `flow`."""
        self.stalled = True

    def flow(self) -> None:
        """Continue to deliver, unless an end of the connection is gone."""
        if self.gone:
            return
        self.stalled = False
        if self._waiting:
            loop = self.connection.network.loop
            loop.call_soon(self._deliver_waiting, context=self.receiver.context)

    def _deliver_waiting(self) -> None:
        while self._waiting and not self.stalled:
            deliver, values = self._waiting[0]
            deliver(*values)
            if self._waiting:
                self._waiting.popleft()

    def _send(self, deliver: Callable[..., None], *values: Any, extra: float | None = None) -> None:
        conditions, chance = self.connection.network.conditions, self.connection.network.random
        now = self.connection.network.loop.time()
        at = now + conditions.latency + chance.random() * conditions.jitter
        if extra:
            at += extra
        else:
            at = self._last = max(at, self._last + SOONEST)
        self._schedule(at - now, deliver, *values)

    def _schedule(self, delay: float, deliver: Callable[..., None], *values: Any) -> None:
        self.connection.network.loop.call_later(
            delay, self._arrive, deliver, values, context=self.receiver.context
        )

    def _arrive(self, deliver: Callable[..., None], values: tuple[Any, ...]) -> None:
        if self.stalled or self._waiting:
            self._waiting.append((deliver, values))
        else:
            deliver(*values)

    def _data(self, unit: Unit) -> None:
        if self._cut:
            self.receiver.answer_reset()
            return
        connection = self.connection
        if connection.network.trace is not None:
            connection.network.trace("arrives", connection.number, self.towards_server, unit)
        self.receiver.feed(unit.data)

    def taken(self, size: int) -> None:
        """Record that the receiver's process has read some bytes."""
        self.unread -= size
        self.sender.has_room()

    def _end(self) -> None:
        if not self._cut:
            self.receiver.feed(None)

    def _break(self) -> None:
        self.receiver.lose(ConnectionResetError(errno.ECONNRESET, "Connection reset by peer"))


class Connection:
    """Two transports and the pipes between them."""

    def __init__(self, network: Network, number: int) -> None:
        self.network = network
        self.number = number
        self.up = Pipe(self, towards_server=True)
        self.down = Pipe(self, towards_server=False)

    def __repr__(self) -> str:
        ends = [
            f"{end.process.name if end.process else ''} {'lost' if end.lost else 'open'} "
            f"{'closing' if end.is_closing() else ''}"
            for end in self.ends
        ]
        return f"<Connection {self.number}: {', '.join(ends)}>"

    @property
    def pipes(self) -> tuple[Pipe, Pipe]:
        return self.up, self.down

    @property
    def ends(self) -> tuple[Transport, Transport]:
        """Return the client's and the server's transport."""
        return self.up.sender, self.down.sender

    def cut(self) -> None:
        """Break the connection for both ends."""
        for pipe in self.pipes:
            pipe.reset()

    def cut_for(self, client: bool) -> None:
        """Break the connection for one end; the other notices when it sends something."""
        (self.down if client else self.up).reset()

    @property
    def alive(self) -> bool:
        return any(not end.lost for end in self.ends)


class Transport(asyncio.Transport):
    """One end of a connection, as asyncio protocols use it."""

    def __init__(self, process: Process | None, out: Pipe, into: Pipe, names: Any) -> None:
        super().__init__()
        self.process = process
        self.context = process.context.copy() if process is not None else None
        self.lost = False
        self._out = out
        self._into = into
        self._names = names
        self._protocol: Any = None
        self._closing = False
        self._ended = False
        self._finishing = False
        self._reading = True
        self._inbox: deque[bytes | None] = deque()
        self._high, self._low = 65536, 16384
        self._full = False
        out.sender = self
        into.receiver = self
        self._loop = out.connection.network.loop

    # Called by protocols

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        return self._names.get(name, default)

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        self._protocol = protocol

    def get_protocol(self) -> asyncio.BaseProtocol:
        protocol: asyncio.BaseProtocol = self._protocol
        return protocol

    def is_closing(self) -> bool:
        return self._closing

    def is_reading(self) -> bool:
        return self._reading

    def pause_reading(self) -> None:
        self._reading = False

    def resume_reading(self) -> None:
        if not self._reading:
            self._reading = True
            if self._inbox:
                self._loop.call_soon(self._read_on, context=self.context)

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        self._high = high if high is not None else 65536
        self._low = low if low is not None else self._high // 4

    def get_write_buffer_limits(self) -> tuple[int, int]:
        return self._low, self._high

    def get_write_buffer_size(self) -> int:
        return 0 if self.lost else self._out.unsent

    def write(self, data: Any) -> None:
        if self._closing or self._ended or self._dead:
            return
        self._out.push(bytes(data))
        if not self._full and self._out.unsent > self._high:
            self._full = True
            self._protocol.pause_writing()

    def writelines(self, list_of_data: Any) -> None:
        self.write(b"".join(list_of_data))

    def can_write_eof(self) -> bool:
        return True

    def write_eof(self) -> None:
        if not (self._closing or self._ended or self._dead):
            self._ended = True
            self._out.finish()

    def close(self) -> None:
        if self._closing or self._dead:
            return
        self._closing = True
        if not self._ended:
            self._ended = True
            self._out.finish()
        if self._out.unsent == 0:
            self._loop.call_soon(self._lose, None, context=self.context)
        else:
            self._finishing = True

    def abort(self) -> None:
        if self.lost or self._dead:
            return
        self._closing = True
        self._out.reset()
        self._loop.call_soon(self._lose, None, context=self.context)

    # Called by the network

    @property
    def _dead(self) -> bool:
        return self.process is not None and self.process.dead

    def answer_reset(self) -> None:
        """Reset the other end, because bytes arrived for a closed connection."""
        if self.lost:
            self._out.reset()

    def feed(self, data: bytes | None) -> None:
        """Receive bytes, or the end of the stream; discard them if the connection ended before it
        was accepted.
        """
        if self._protocol is None:
            return
        if self._closing or self.lost:
            if data is not None:
                self._into.unread -= len(data)
                if self.lost:
                    self._out.reset()
            return
        if self._reading and not self._inbox:
            self._take(data)
        else:
            self._inbox.append(data)

    def _read_on(self) -> None:
        while self._inbox and self._reading and not self._closing:
            self._take(self._inbox.popleft())

    def _take(self, data: bytes | None) -> None:
        if data is None:
            if not self._protocol.eof_received():
                self.close()
            return
        self._into.taken(len(data))
        if isinstance(self._protocol, asyncio.BufferedProtocol):
            while data:
                buffer = memoryview(self._protocol.get_buffer(len(data)))
                size = min(len(buffer), len(data))
                buffer[:size] = data[:size]
                self._protocol.buffer_updated(size)
                data = data[size:]
        else:
            self._protocol.data_received(data)

    def has_room(self) -> None:
        """Continue to write, because the other end has read something."""
        if self.lost:
            return
        if self._full and self._out.unsent <= self._low:
            self._full = False
            self._loop.call_soon(self._resume_writing, context=self.context)
        if self._finishing and self._out.unsent == 0:
            self._finishing = False
            self._loop.call_soon(self._lose, None, context=self.context)

    def _resume_writing(self) -> None:
        if not self.lost:
            self._protocol.resume_writing()

    def lose(self, error: Exception) -> None:
        """Handle a broken connection."""
        self._closing = True
        self._lose(error)

    def _lose(self, error: Exception | None) -> None:
        if self.lost:
            return
        self.lost = True
        self._inbox.clear()
        self._out.connection.network.forget(self)
        if self._protocol is not None:
            self._protocol.connection_lost(error)

    def die(self, politely: bool) -> None:
        """Let the kernel close the connection of a dead process."""
        if self.lost:
            return
        self.lost = self._closing = True
        self._inbox.clear()
        self._out.connection.network.forget(self)
        if politely:
            self._out.finish()
        else:
            self._out.reset()

    def vanish(self) -> None:
        """Remove the machine without a packet to the other end."""
        self.lost = self._closing = True
        self._inbox.clear()
        for pipe in (self._out, self._into):
            pipe.stall()
            pipe.gone = True
        network = self._out.connection.network
        network.never_opened(self._into.sender)
        self._out.connection.network.forget(self)
