"""Connections to the operator port: how many may be open, and how long each may take.

uvicorn cannot protect the operator here. Its `limit_concurrency` answers 503 to everyone, so a
flood would lock the operator out, and none of its options limits the time before the first
request or the time that a client takes to read a response. So each connection holds a slot and
has deadlines. uvicorn only parses HTTP.
"""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable
from enum import IntEnum
from http import HTTPStatus
from itertools import count
from typing import Any, cast

from uvicorn import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState
from websockets.datastructures import Headers

from robotouille.web.bounded_requests import BoundedRequests
from robotouille_server.auth import visitor
from robotouille_server.operator.principal import RequestRefusedError
from robotouille_server.transport import LoopBudget, ServerTLS
from robotouille_server.transport.tls_records import ClientHello, start_metered_tls

REQUEST_SECONDS = 10.0
"""Time limit for a TLS handshake, for a request's head and for its body."""
KEEP_ALIVE_SECONDS = 5
"""Time limit for the first byte of the next request."""
STALL_SECONDS = 30.0
"""Time limit for any progress of a response that waits to be read."""
MAX_CONNECTIONS = 128
MAX_PER_ADDRESS = 32
"""Connections per address without a token. This machine may use all slots."""
MAX_PER_SUBJECT = 32
"""Connections with tokens of one subject, so that one operator leaves room for others."""


class Standing(IntEnum):
    """Standing of a connection. Those with a lower value are replaced first."""

    SILENT = 0
    """The connection has not made a request yet."""
    IDLE = 1
    """The connection is between two requests."""
    BUSY = 2
    """The server is answering a request without a token."""
    KNOWN = 3
    """The last request had a valid token."""


class ConnectionSlot:
    """The place and the deadlines of one connection.

    `group` is what the connection's address counts as; it is empty for this machine. `cut` closes
    the connection at once. `unsent` returns how many bytes wait for the client to read them.
    """

    def __init__(
        self,
        slots: ConnectionSlots,
        address: str,
        group: str,
        cut: Callable[[], None],
        unsent: Callable[[], int],
    ) -> None:
        self._slots = slots
        self.address = address
        self.group = group
        self.cut = cut
        self._unsent = unsent
        self.standing = Standing.SILENT
        self.since = slots.next_moment()
        self.subject = ""
        self._waiting_since: float | None = slots.now()
        self._progress: tuple[float, int] | None = None

    def encrypted(self) -> None:
        """Start the deadline of the first request, because the TLS handshake is complete."""
        self._waiting_since = self._slots.now()

    def request_started(self, *, has_body: bool) -> None:
        """Note that the head of a request has arrived."""
        self._stand(Standing.BUSY)
        self._waiting_since = self._slots.now() if has_body else None

    def body_received(self) -> None:
        self._waiting_since = None

    def authenticated(self, subject: str) -> None:
        """Keep the slot, because the request has a valid token.

        Raises:
            RequestRefusedError: The subject has too many connections.
        """
        if self._slots.known(subject, other_than=self) >= MAX_PER_SUBJECT:
            message = f"{MAX_PER_SUBJECT} connections use your token already; close one"
            raise RequestRefusedError(HTTPStatus.SERVICE_UNAVAILABLE, "operator/busy", message)
        self.subject = subject
        self._stand(Standing.KNOWN)

    def request_finished(self) -> None:
        """Start the deadline of the next request."""
        if self.standing is not Standing.KNOWN:
            self._stand(Standing.IDLE)
        self._waiting_since = self._slots.now()

    def progressed(self) -> None:
        """Note that the client has read what was written, so more of the response follows."""
        self._progress = None

    def release(self) -> None:
        """Free the slot, because the connection is closed."""
        self._slots.remove(self)

    def check(self, now: float) -> None:
        """Close the connection if its client sends or reads too slowly."""
        unsent = self._unsent()
        if unsent:
            # A client that still reads the last response gets the full time for its next request.
            if self._waiting_since is not None:
                self._waiting_since = now
            if self._progress is None or unsent < self._progress[1]:
                self._progress = now, unsent
            elif now - self._progress[0] >= STALL_SECONDS:
                self.cut()
            else:
                # An event stream may add data: compare with the last size, not the first.
                self._progress = self._progress[0], unsent
            return
        self._progress = None
        if self._waiting_since is not None and now - self._waiting_since >= REQUEST_SECONDS:
            self.cut()

    def _stand(self, standing: Standing) -> None:
        self.standing = standing
        self.since = self._slots.next_moment()


class ConnectionSlots:
    """All connections of the operator port.

    A flood of connections must not lock the operator out. So a newcomer always gets a slot while
    any connection has no token. It replaces the connection with the
    lowest standing, and of these the one that has had this standing for the longest time.
    Connections with a valid token are never replaced.
    """

    def __init__(self, now: Callable[[], float]) -> None:
        self.now = now
        self._taken: set[ConnectionSlot] = set()
        # Several events can share one time of the loop, so a counter orders them.
        self._moments = count()

    def __len__(self) -> int:
        return len(self._taken)

    def take(
        self, peer: object, cut: Callable[[], None], unsent: Callable[[], int] = lambda: 0
    ) -> ConnectionSlot | None:
        """Return a slot for a new connection; None if all slots belong to valid tokens."""
        who = visitor(peer, Headers())
        # A tunnel or proxy on this machine carries several operators, so it has no limit.
        group = "" if who.local else who.group
        if group:
            same = [slot for slot in self._unknown() if slot.group == group]
            if len(same) >= MAX_PER_ADDRESS:
                # A stranger replaces connections of the stranger's own address first.
                self._replace_one(same)
        if len(self._taken) >= MAX_CONNECTIONS:
            unknown = self._unknown()
            if not unknown:
                return None
            self._replace_one(unknown)
        slot = ConnectionSlot(self, who.address, group, cut, unsent)
        self._taken.add(slot)
        return slot

    def known(self, subject: str, other_than: ConnectionSlot) -> int:
        """Return how many other connections have tokens of a subject."""
        return sum(
            slot.subject == subject and slot.standing is Standing.KNOWN
            for slot in self._taken
            if slot is not other_than
        )

    def check(self) -> None:
        """Close connections whose client is too slow. Call this about once per second."""
        now = self.now()
        for slot in list(self._taken):
            slot.check(now)

    def next_moment(self) -> int:
        """Return a larger number with each call."""
        return next(self._moments)

    def remove(self, slot: ConnectionSlot) -> None:
        self._taken.discard(slot)

    def clear(self) -> None:
        """Close all connections."""
        for slot in list(self._taken):
            slot.cut()
        self._taken.clear()

    def _unknown(self) -> list[ConnectionSlot]:
        return [slot for slot in self._taken if slot.standing is not Standing.KNOWN]

    def _replace_one(self, slots: list[ConnectionSlot]) -> None:
        replaced = min(slots, key=lambda slot: (slot.standing, slot.since))
        self.remove(replaced)
        replaced.cut()


class OperatorConnection(asyncio.Protocol):
    """Connection that takes a slot when it is accepted, then encrypts, then passes data to HTTP.

    The slot comes first: a client that never finishes the TLS handshake must hold one too.
    """

    def __init__(
        self,
        slots: ConnectionSlots,
        tls: ssl.SSLContext | None,
        budget: LoopBudget,
        handshakes: set[asyncio.Task[None]],
        make_http: Callable[[ConnectionSlot], asyncio.Protocol],
    ) -> None:
        self._slots = slots
        self._tls = tls
        self._budget = budget
        self._handshakes = handshakes
        self._make_http = make_http
        self._http: asyncio.Protocol | None = None
        self._slot: ConnectionSlot | None = None
        self._transports: list[asyncio.Transport] = []
        self._early = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        raw = cast("asyncio.Transport", transport)
        self._transports.append(raw)
        # `raw.abort` also ends an encrypted connection, without waiting for TLS's closing alert.
        self._slot = self._slots.take(raw.get_extra_info("peername"), raw.abort, self._unsent)
        if self._slot is None:
            raw.abort()
        elif self._tls is None:
            self._start_http(self._slot, raw)
        else:
            raw.pause_reading()  # start_tls must receive the handshake from its first byte on.
            task = asyncio.create_task(
                self._encrypt(self._slot, raw, self._tls), name="operator port: TLS handshake"
            )
            self._handshakes.add(task)
            task.add_done_callback(self._handshakes.discard)

    async def _encrypt(
        self, slot: ConnectionSlot, raw: asyncio.Transport, tls: ssl.SSLContext
    ) -> None:
        encrypted = None
        # Strangers can cause failed handshakes at will, so these are not logged.
        try:
            encrypted = await start_metered_tls(
                ClientHello(raw, group=slot.group or None), self, tls, self._budget, REQUEST_SECONDS
            )
        except OSError as error:
            error.__traceback__ = None  # As in `Handshakes.make`: a cycle would keep the TLS.
        if encrypted is None or raw.is_closing():
            raw.abort()
            self._forget()
        else:
            self._transports.append(encrypted)
            slot.encrypted()
            self._start_http(slot, encrypted)

    def _start_http(self, slot: ConnectionSlot, transport: asyncio.Transport) -> None:
        self._http = self._make_http(slot)
        self._http.connection_made(transport)
        if self._early:
            self._http.data_received(self._early)
            self._early = b""

    def data_received(self, data: bytes) -> None:
        if self._http is None:
            # The first request can arrive before start_tls has returned the encrypted transport.
            self._early += data
        else:
            self._http.data_received(data)

    def eof_received(self) -> bool | None:
        return None if self._http is None else self._http.eof_received()

    def pause_writing(self) -> None:
        if self._http is not None:
            self._http.pause_writing()

    def resume_writing(self) -> None:
        if self._slot is not None:
            self._slot.progressed()
        if self._http is not None:
            self._http.resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        http = self._http
        self._forget()
        if http is not None:
            http.connection_lost(exc)

    def _forget(self) -> None:
        """Free the slot, and all references that would keep this object until a collection."""
        if self._slot is not None:
            self._slot.release()
        self._slot = self._http = None
        self._transports.clear()

    def _unsent(self) -> int:
        return sum(transport.get_write_buffer_size() for transport in self._transports)


class ConnectionFactory:
    """Maker of connections in the form that uvicorn's option `http` expects.

    Handlers find the connection's slot in the request's state.
    """

    def __init__(self, slots: ConnectionSlots, tls: ServerTLS | None, budget: LoopBudget) -> None:
        self._slots = slots
        self._tls = tls
        self._budget = budget
        self._handshakes: set[asyncio.Task[None]] = set()

    def __call__(
        self, config: Config, server_state: ServerState, app_state: dict[str, Any], _loop: Any
    ) -> asyncio.Protocol:
        def http(slot: ConnectionSlot) -> asyncio.Protocol:
            protocol = H11Protocol(config, server_state, {**app_state, "slot": slot}, _loop)
            protocol.conn = BoundedRequests()
            return protocol

        tls = self._tls.context if self._tls is not None else None
        return OperatorConnection(self._slots, tls, self._budget, self._handshakes, http)

    async def close(self) -> None:
        """Close all connections."""
        self._slots.clear()
        for task in self._handshakes:
            task.cancel()
        await asyncio.gather(*self._handshakes, return_exceptions=True)
