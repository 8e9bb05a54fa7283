"""Broker in this process that sends arbitrary packets."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from paho.mqtt.properties import VariableByteIntegers

__all__ = ["CONNACK", "PINGRESP", "LyingBroker", "packet", "published", "received", "text"]

CONNACK = bytes([0x20, 3, 0, 0, 0])
PINGRESP = bytes([0xD0, 0])


def packet(first: int, body: bytes) -> bytes:
    """Return an MQTT packet with an honest length."""
    length: bytes = VariableByteIntegers.encode(len(body))  # type: ignore[no-untyped-call]
    return bytes([first]) + length + body


def text(value: str) -> bytes:
    """Return a string of MQTT."""
    return len(value.encode()).to_bytes(2, "big") + value.encode()


def published(payload: bytes, properties: bytes = b"", number: int = 0) -> bytes:
    """Return a command with properties, of QoS 1 if it has a number."""
    identifier = number.to_bytes(2, "big") if number else b""
    length: bytes = VariableByteIntegers.encode(len(properties))  # type: ignore[no-untyped-call]
    body = text("robotouille/v1/lab/commands") + identifier + length + properties + payload
    return packet(0x32 if number else 0x30, body)


async def received(reader: asyncio.StreamReader) -> tuple[int, bytes]:
    """Return the first byte and the body of the client's next packet."""
    first, length, shift = (await reader.readexactly(1))[0], 0, 0
    while (byte := (await reader.readexactly(1))[0]) >= 128:
        length, shift = length | (byte & 127) << shift, shift + 7
    return first, await reader.readexactly(length | byte << shift)


class LyingBroker:
    """Broker that works until the server is online, and then sends `lie`, and `more` without end.

    Without `more`, it continues to work. `sent` counts the bytes of each connection after the lie,
    and `packets` are those that it received. `granted` is its answer to the subscription.
    """

    def __init__(
        self,
        lie: bytes,
        more: bytes = b"",
        tls: ssl.SSLContext | None = None,
        granted: int = 1,
    ) -> None:
        self.lie = lie
        self.more = more
        self.sent: list[int] = []
        self.packets: list[tuple[int, bytes]] = []
        self._tls = tls
        self._granted = granted

    @asynccontextmanager
    async def listening(self) -> AsyncIterator[str]:
        """Listen, and yield the URL."""
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0, ssl=self._tls)
        scheme = "mqtt" if self._tls is None else "mqtts"
        async with server:
            yield f"{scheme}://127.0.0.1:{server.sockets[0].getsockname()[1]}"

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await received(reader)
            writer.write(CONNACK)
            _, subscribe = await received(reader)
            writer.write(packet(0x90, subscribe[:2] + bytes([0, self._granted])))
            self._acknowledge(writer, *await received(reader))
            writer.write(self.lie)
            self.sent.append(0)
            await (self._pour(writer) if self.more else self._work(reader, writer))
        except (ConnectionError, asyncio.IncompleteReadError):
            pass
        finally:
            writer.close()

    async def _pour(self, writer: asyncio.StreamWriter) -> None:
        while not writer.is_closing():
            writer.write(self.more)
            self.sent[-1] += len(self.more)
            await writer.drain()
            await asyncio.sleep(0.01)

    async def _work(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while True:
            first, body = await received(reader)
            self.packets.append((first, body))
            self._acknowledge(writer, first, body)

    @staticmethod
    def _acknowledge(writer: asyncio.StreamWriter, first: int, body: bytes) -> None:
        if first & 0xF6 == 0x32:
            number = 2 + int.from_bytes(body[:2], "big")
            writer.write(packet(0x40, body[number : number + 2]))
