"""NATS client that ends its connection before a message fills the memory. It needs `nats-py`."""

from __future__ import annotations

from nats.aio.client import Client
from nats.errors import ProtocolError
from nats.protocol.parser import Parser

RECONNECT_SECONDS = 0.2
"""Seconds between two attempts to connect to a server again."""
MAX_MESSAGE = 8 * 1024 * 1024
"""Bytes of a message. NATS recommends this limit to its operators."""


def bounded_client() -> Client:
    """Return a client that is not connected yet."""
    client = Client()
    # The library has no option for a limit.
    client._ps = _BoundedParser(client)
    return client


class _BoundedParser(Parser):
    """Parser that ends the connection before a message of any announced length fills the memory."""

    async def parse(self, data: bytes = b"") -> None:
        await super().parse(data)
        if max(self.needed, len(self.buf)) > MAX_MESSAGE:
            self.reset()
            raise ProtocolError
