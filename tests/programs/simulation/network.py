"""The network: listeners, connections, and the quality of the connections."""

from __future__ import annotations

import asyncio
import errno
import random
import socket
from collections.abc import Callable
from typing import Any

from tests.programs.simulation.loop import Process, SimulatedLoop, current_process
from tests.programs.simulation.transport import Conditions, Connection, Transport

__all__ = ["Listener", "Network"]

Trace = Callable[..., None]


class _Socket:
    family = socket.AF_INET

    def __init__(self, port: int) -> None:
        self._port = port

    def getsockname(self) -> tuple[str, int]:
        return ("127.0.0.1", self._port)

    def dup(self) -> _Socket:
        return self

    def __enter__(self) -> _Socket:
        return self

    def __exit__(self, *exc: object) -> None:
        return None

    def listen(self, backlog: int) -> None:
        return None


class Listener:
    """Result of `create_server`, which accepts connections until it is closed."""

    def __init__(self, network: Network, factory: Callable[[], Any], port: int) -> None:
        self.network = network
        self.factory = factory
        self.port = port
        self.process = current_process()
        self._sockets: tuple[_Socket, ...] = (_Socket(port),)
        self._waiters: list[asyncio.Future[None]] = []

    @property
    def sockets(self) -> tuple[_Socket, ...]:
        return self._sockets

    def get_loop(self) -> SimulatedLoop:
        return self.network.loop

    def is_serving(self) -> bool:
        return bool(self._sockets)

    async def start_serving(self) -> None:
        pass

    def close(self) -> None:
        self._sockets = ()
        self.network.unlisten(self)
        self.transport_gone()

    async def wait_closed(self) -> None:
        """Wait for the connections, like Python 3.12.1 and later; earlier versions did not."""
        if self.network.patient_close and self.network.accepted(self):
            waiter = self.network.loop.create_future()
            self._waiters.append(waiter)
            await waiter

    def transport_gone(self) -> None:
        if not self._sockets and not self.network.accepted(self):
            for waiter in self._waiters:
                if not waiter.done():
                    waiter.set_result(None)


class Network:
    """All listeners and connections of a simulation."""

    def __init__(
        self, loop: SimulatedLoop, chance: random.Random, conditions: Conditions | None = None
    ) -> None:
        self.loop = loop
        self.random = chance
        self.conditions = conditions or Conditions()
        self.trace: Trace | None = None
        self.patient_close = True
        self.refusing: str = ""
        self.on_connect: Callable[[Connection], None] | None = None
        self.opened = 0
        self._listeners: dict[int, list[Listener]] = {}
        self._transports: dict[Transport, Listener | None] = {}
        self._opening: dict[Transport, Listener] = {}
        self._next_port = 40000
        loop.network = self

    # Servers

    def listen(self, factory: Callable[[], Any], port: int, shared: bool) -> Listener:
        if port == 0:
            self._next_port += 1
            port = self._next_port
        if self._listeners.get(port) and not shared:
            raise OSError(errno.EADDRINUSE, "Address already in use")
        listener = Listener(self, factory, port)
        self._listeners.setdefault(port, []).append(listener)
        if listener.process is not None:
            listener.process.on_death.append(lambda: self.unlisten(listener))
        return listener

    def unlisten(self, listener: Listener) -> None:
        listeners = self._listeners.get(listener.port, [])
        if listener in listeners:
            listeners.remove(listener)

    def accepted(self, listener: Listener) -> list[Transport]:
        """Return the open connections that a listener has accepted."""
        return [t for t, accepted_by in self._transports.items() if accepted_by is listener]

    # Connections

    async def connect(
        self, factory: Callable[[], Any], host: str, port: int
    ) -> tuple[Transport, Any]:
        """Connect from the present process; raise `OSError` if there is no listener."""
        client = current_process()
        await asyncio.sleep(self._latency())
        if self.refusing == "silent":
            await asyncio.sleep(3600)
        listeners = self._listeners.get(port)
        if self.refusing or not listeners:
            raise ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")
        listener = listeners[self.random.randrange(len(listeners))]
        self.opened += 1
        connection = Connection(self, self.opened)
        near, far = (client.host if client else "127.0.0.1", 50000 + self.opened), (host, port)
        mine = Transport(
            client, connection.up, connection.down, {"sockname": near, "peername": far}
        )
        theirs = Transport(
            listener.process, connection.down, connection.up, {"sockname": far, "peername": near}
        )
        self._transports[mine] = None
        self._opening[theirs] = listener
        if self.on_connect is not None:
            self.on_connect(connection)
        connection.up.open(self._accept, listener, theirs)
        protocol = factory()
        mine.set_protocol(protocol)
        protocol.connection_made(mine)
        return mine, protocol

    def _accept(self, listener: Listener, transport: Transport) -> None:
        if transport.lost:
            return
        if not listener.is_serving():
            transport.die(politely=False)
            return
        self._transports[transport] = self._opening.pop(transport)
        protocol = listener.factory()
        transport.set_protocol(protocol)
        protocol.connection_made(transport)

    def _latency(self) -> float:
        return self.conditions.latency + self.random.random() * self.conditions.jitter

    def connections(self) -> list[Connection]:
        """Return the connections that are open for at least one end, oldest first."""
        seen: dict[int, Connection] = {}
        for transport in self._transports:
            connection = transport._out.connection
            seen[connection.number] = connection
        return list(seen.values())

    def transports(self, process: Process) -> list[Transport]:
        everything = (*self._transports, *self._opening)
        return [t for t in everything if t.process is process]

    def forget(self, transport: Transport) -> None:
        self._opening.pop(transport, None)
        listener = self._transports.pop(transport, None)
        if listener is not None:
            listener.transport_gone()

    def never_opened(self, transport: Transport) -> None:
        """Record that this end will never be accepted."""
        self._opening.pop(transport, None)

    def close_all(self, process: Process, *, silently: bool = False) -> None:
        """End the connections of a dead process, or of a whole machine if `silently`."""
        for transport in self.transports(process):
            if silently:
                transport.vanish()
            else:
                transport.die(politely=self.random.random() < 0.5)
