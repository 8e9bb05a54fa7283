"""Somebody who is accepted and has said nothing yet, of whom little is kept.

TLS is made here: asyncio's own way would tell of a connection only when its handshake is over, and
of one that says nothing never. The library's connection, with its task, comes with the first byte.
"""

from __future__ import annotations

import asyncio
import ssl
from typing import Any, cast

from websockets.asyncio.server import Server
from websockets.server import ServerProtocol

from robotouille_server.runtime.descriptors import few_left
from robotouille_server.transport.admission import Admission
from robotouille_server.transport.connection import MAX_REQUEST, Connection

__all__ = ["PendingConnection"]


class PendingConnection(asyncio.Protocol):
    """Goes on as a `Connection` as soon as there is something to read; one that has nothing to say
    is cut off in time."""

    __slots__ = (
        "_admission", "_admitted", "_early", "_encrypting", "_options", "_server", "_timer",
        "_transport", "protocol",
    )  # fmt: skip

    def __init__(
        self, protocol: ServerProtocol, server: Server, *, admission: Admission, **options: Any
    ) -> None:
        self.protocol = protocol
        """The library knows by it whose subprotocol it chooses."""
        self._server = server
        self._options = options
        self._admission = admission
        self._admitted = False
        self._transport: asyncio.Transport | None = None
        self._early = b""
        self._encrypting: asyncio.Task[None] | None = None
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        raw, admission = cast("asyncio.Transport", transport), self._admission
        few = few_left(raw.get_extra_info("socket"))
        self._admitted = not few and admission.admit()
        if not self._admitted:
            count = admission.metrics.dropped
            (count.labels("descriptors") if few else count.labels("full")).inc()
            raw.abort()
            return
        admission.pending.add(self)
        if admission.tls is None:
            self._wait(raw)
        else:
            self._transport = raw
            raw.pause_reading()  # The handshake is start_tls's business from its first byte on.
            loop = asyncio.get_running_loop()
            self._encrypting = loop.create_task(self._encrypt(raw, admission.tls))

    async def _encrypt(self, raw: asyncio.Transport, tls: ssl.SSLContext) -> None:
        encrypted, admission = None, self._admission
        try:
            encrypted = await admission.handshakes.make(raw, self, tls, admission.opening_seconds)
        finally:
            self._encrypting = None
            if encrypted is None:
                raw.abort()
                self._end()
        if encrypted is not None:
            self._wait(encrypted)

    def _wait(self, transport: asyncio.Transport) -> None:
        self._transport = transport
        if self._early:
            self._go_on(self._early)
            return
        loop = asyncio.get_running_loop()
        self._timer = loop.call_later(self._admission.opening_seconds, transport.abort)

    def abort(self) -> None:
        """Cut it off."""
        if self._transport is not None:
            self._transport.abort()

    def data_received(self, data: bytes) -> None:
        if self._encrypting is None:
            self._go_on(data)
        elif len(self._early) + len(data) <= MAX_REQUEST:
            self._early += data  # It came with the end of the handshake, of which we hear later.
        else:
            self.abort()

    def _go_on(self, data: bytes) -> None:
        transport = self._transport
        if transport is None:
            return
        self._forget()
        connection = Connection(
            self.protocol, self._server, admission=self._admission, **self._options
        )
        transport.set_protocol(connection)
        connection.connection_made(transport)
        connection.data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._encrypting is not None:
            self._encrypting.cancel()
        self._end()

    def _end(self) -> None:
        self._forget()
        if self._admitted:
            self._admitted = False
            self._admission.release()

    def _forget(self) -> None:
        self._admission.pending.discard(self)
        self._transport = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
