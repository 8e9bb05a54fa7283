"""Connections to the operator's port: HTTP/1.1 by uvicorn, with time-outs and slots.

Needs the extra `operator`.
"""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable
from typing import Any, cast

import h11
from uvicorn import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from robotouille_server.admin.http.connection_slots import ConnectionSlot, ConnectionSlots, Standing
from robotouille_server.admin.http.timeouts import REQUEST_SECONDS, STALL_SECONDS

__all__ = ["HttpPort"]


class HttpPort(asyncio.Protocol):
    """A connection from the moment it is accepted: it takes a place, encrypts where that is
    asked for, and hands on to HTTP. What comes before that is kept."""

    def __init__(
        self,
        config: Config,
        state: ServerState,
        slots: ConnectionSlots,
        tls: ssl.SSLContext | None,
        opening: set[asyncio.Task[None]],
    ) -> None:
        self._config = config
        self._state = state
        self._slots = slots
        self._tls = tls
        self._opening = opening
        self._early = b""
        self._slot: ConnectionSlot | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        raw = cast("asyncio.Transport", transport)
        self._slot = self._slots.take(raw.get_extra_info("peername"), raw.abort)
        if self._slot is None:
            raw.abort()
        elif self._tls is None:
            self._hand_on(self._slot, raw, raw)
        else:
            raw.pause_reading()  # The handshake is start_tls's business from its first byte on.
            task = asyncio.get_running_loop().create_task(
                self._encrypt(self._slot, raw, self._tls), name="operator's handshake"
            )
            self._opening.add(task)
            task.add_done_callback(self._opening.discard)

    def data_received(self, data: bytes) -> None:
        self._early += data

    def connection_lost(self, exc: Exception | None) -> None:
        if self._slot is not None:
            self._slot.leave()
            self._slot = None

    async def _encrypt(
        self, slot: ConnectionSlot, raw: asyncio.Transport, tls: ssl.SSLContext
    ) -> None:
        try:
            encrypted = await asyncio.get_running_loop().start_tls(
                raw, self, tls, server_side=True, ssl_handshake_timeout=REQUEST_SECONDS
            )
        except OSError:  # A handshake that fails or takes too long is nobody's business.
            encrypted = None
        if encrypted is None or self._slot is None:
            slot.leave()
            raw.abort()
            return
        self._hand_on(slot, encrypted, raw)

    def _hand_on(
        self, slot: ConnectionSlot, transport: asyncio.Transport, raw: asyncio.Transport
    ) -> None:
        http = PortProtocol(self._config, self._state, slot, raw)
        transport.set_protocol(http)
        http.connection_made(transport)
        if self._early:
            http.data_received(self._early)


class PortProtocol(H11Protocol):
    """Gives up on a client that does not send what it has begun, or does not read its answer."""

    def __init__(
        self, config: Config, state: ServerState, slot: ConnectionSlot, raw: asyncio.Transport
    ) -> None:
        super().__init__(config, state, {"slot": slot})
        self._slot = slot
        self._raw = raw
        self._awaited: Any = None
        self._deadline: asyncio.TimerHandle | None = None
        self._read_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._await_client()

    def connection_lost(self, exc: Exception | None) -> None:
        self._slot.leave()
        for timer in (self._deadline, self._read_timer):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        before = self.cycle
        super().handle_events()
        if self.cycle is not before:
            self._slot.stand(Standing.BUSY)
        self._await_client()

    def on_response_complete(self) -> None:
        self._slot.answered()
        super().on_response_complete()
        self._await_client()

    def timeout_keep_alive_handler(self) -> None:
        super().timeout_keep_alive_handler()
        self._await_reader()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._await_reader()

    def resume_writing(self) -> None:
        super().resume_writing()
        if self._read_timer is not None and not self.transport.is_closing():
            self._read_timer.cancel()
            self._read_timer = None

    def _await_client(self) -> None:
        """A request's head must be there in time, counted from the connection's beginning or the
        end of the last answer, and so must its body, counted from its head."""
        if self.transport.is_closing():
            self._await_reader()
        theirs = self.conn.their_state
        awaited = theirs if theirs in (h11.IDLE, h11.SEND_BODY) else None
        if awaited is self._awaited:
            return
        self._awaited = awaited
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
        if awaited is not None:
            self._deadline = self._later(REQUEST_SECONDS, self._too_late)

    def _too_late(self) -> None:
        """Who is still reading the last answer has time for the next request."""
        if self._unsent():
            self._await_reader()
            self._deadline = self._later(REQUEST_SECONDS, self._too_late)
        else:
            self._raw.abort()

    def _await_reader(self) -> None:
        """An answer that waits for the client must become shorter."""
        if self._read_timer is None:
            self._read_timer = self._later(STALL_SECONDS, self._look, self._unsent())

    def _look(self, unsent: int) -> None:
        self._read_timer = None
        left = self._unsent()
        if left >= unsent:
            self._raw.abort()
        else:
            self._read_timer = self._later(STALL_SECONDS, self._look, left)

    def _unsent(self) -> int:
        """Bytes that wait to be taken by the network, encrypted or not."""
        transports = {self._raw, self.transport}
        return sum(transport.get_write_buffer_size() for transport in transports)

    def _later(
        self, seconds: float, call: Callable[..., object], *arguments: Any
    ) -> asyncio.TimerHandle:
        return self.loop.call_later(seconds, call, *arguments)
