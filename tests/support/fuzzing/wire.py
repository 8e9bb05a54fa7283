"""WebSocket client by hand, with valid and invalid handshakes and frames.

It uses neither the project's code nor its WebSocket library, so that tests can send any bytes over
a TCP connection.
"""

from __future__ import annotations

import asyncio
import base64
import json
import os
import struct
from collections.abc import AsyncIterator
from typing import Any

import msgpack

from tests.support.fuzzing.adversary import Adversary

__all__ = [
    "BINARY",
    "CLOSE",
    "CONTINUATION",
    "PING",
    "PONG",
    "TEXT",
    "Closed",
    "Wire",
    "frame",
    "hostile_frames",
    "hostile_request",
    "request",
]

CONTINUATION, TEXT, BINARY, CLOSE, PING, PONG = 0, 1, 2, 8, 9, 10
PROTOCOLS = {True: "robotouille.v1.json", False: "robotouille.v1.msgpack"}


def frame(
    payload: bytes,
    opcode: int = TEXT,
    *,
    fin: bool = True,
    masked: bool = True,
    reserved: int = 0,
    claimed: int | None = None,
) -> bytes:
    """Return a client's frame; `claimed` is a false length."""
    size = len(payload) if claimed is None else claimed
    first = (0x80 if fin else 0) | reserved << 4 | opcode
    mark = 0x80 if masked else 0
    if size < 126:
        head = bytes([first, mark | size])
    elif size < 65536:
        head = bytes([first, mark | 126]) + struct.pack(">H", size)
    else:
        head = bytes([first, mark | 127]) + struct.pack(">Q", size)
    # A mask of zeros is valid and leaves the payload unchanged.
    return head + (b"\0\0\0\0" if masked else b"") + payload


def request(subprotocol: str | None = None, *, path: str = "/", more: str = "") -> bytes:
    """Return a valid WebSocket handshake."""
    key = base64.b64encode(os.urandom(16)).decode()
    offered = f"Sec-WebSocket-Protocol: {subprotocol}\r\n" if subprotocol else ""
    return (
        f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n"
        f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
        f"{offered}{more}\r\n"
    ).encode()


WRONG_REQUESTS = (
    b"", b"\r\n\r\n", b"GET / HTTP/1.1\r\n\r\n", b"GET / HTTP/1.1\r\nHost: x\r\n", b"GET /",
    b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\n\r\nhello", b"GET / HTTP/9.9\r\n\r\n",
    b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n", b"GET /metrics?x=1 HTTP/1.1\r\n\r\n",
    b"GET /../../etc/passwd HTTP/1.1\r\nHost: x\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00" * 30,
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", b"\x00" * 5000, b"A" * 20_000, b"SSH-2.0-x\r\n",
    b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 500 + b"\r\n",
    b"GET /" + b"a" * 10_000 + b" HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: x\r\nX: " + b"y" * 10_000 + b"\r\n\r\n",
    b"GET / HTTP/1.1\r\nX : y\r\n\r\n", b"GET / HTTP/1.1\r\nX\x00: y\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    b"GET \xff\xfe HTTP/1.1\r\nHost: \xff\r\n\r\n",
)  # fmt: skip
SPOILT_HEADERS = (
    "Upgrade: websocket\r\n", "Upgrade: h2c\r\n", "Connection: close\r\n", "Host: y\r\n",
    "Sec-WebSocket-Version: 12\r\n", "Sec-WebSocket-Version: x\r\n", "Sec-WebSocket-Key: short\r\n",
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n", "Sec-WebSocket-Protocol: ,,;\r\n",
    "Sec-WebSocket-Protocol: robotouille.v1.json\r\n", "Sec-WebSocket-Protocol: \x7f\r\n",
    "Sec-WebSocket-Extensions: permessage-deflate; server_max_window_bits=99\r\n",
    "Sec-WebSocket-Extensions: ;;\r\n", "Content-Length: 9999999999\r\n",
    "Origin: https://a.b\r\n",
    "X-Forwarded-For: 1.2.3.4, x\r\n", "Forwarded: for=\"[::1\"\r\n",
    "Cookie: " + "a" * 5000 + "\r\n",
)  # fmt: skip


def hostile_request(adversary: Adversary) -> bytes:
    """Return an invalid WebSocket handshake, or another HTTP request."""
    pick = adversary.random.random()
    if pick < 0.4:
        return adversary.random.choice(WRONG_REQUESTS)
    more = "".join(
        adversary.random.choice(SPOILT_HEADERS) for _ in range(adversary.random.choice((1, 1, 3)))
    )
    whole = request(adversary.random.choice((*PROTOCOLS.values(), "chat", None)), more=more)
    return whole if pick < 0.7 else adversary.damaged(whole)


def hostile_frames(adversary: Adversary, payload: bytes, opcode: int) -> bytes:
    """Return a message in frames that mostly violate the WebSocket protocol."""
    choose = adversary.random.choice
    half = len(payload) // 2
    return choose(
        (
            lambda: frame(payload, opcode, masked=False),
            lambda: frame(payload, opcode, reserved=choose((1, 2, 4, 7))),
            lambda: frame(payload, choose((3, 4, 7, 11, 15))),
            lambda: frame(payload, CONTINUATION),
            lambda: frame(payload[:half], opcode, fin=False) + frame(payload, opcode),
            lambda: frame(payload, opcode, claimed=choose((2**63, 2**62, 200_000, 2**64 - 1))),
            lambda: frame(b"x" * choose((70_000, 140_000)), opcode),
            lambda: frame(b"p" * 126, choose((PING, PONG, CLOSE))),
            lambda: frame(b"p", choose((PING, PONG)), fin=False),
            lambda: frame(b"\x03", CLOSE),
            lambda: frame(struct.pack(">H", choose((0, 999, 1005, 1006, 1015, 5000))), CLOSE),
            lambda: frame(struct.pack(">H", 1000) + b"\xff\xfe", CLOSE),
            lambda: frame(b"\xff\xfe\xfd", TEXT),
            lambda: adversary.damaged(frame(payload, opcode)),
            lambda: frame(payload[:half], opcode, fin=False) + frame(b"", PING)
            + frame(b"", CONTINUATION, fin=False) * 3 + frame(payload[half:], CONTINUATION),
            lambda: frame(payload, opcode)[: half + 2],
        )
    )()  # fmt: skip


class Closed(Exception):
    """The server closed the connection; `code` comes from its close frame, if there was one."""

    def __init__(self, code: int | None = None) -> None:
        self.code = code
        super().__init__(f"closed with {code}")


class Wire:
    """TCP connection to a server that can send any bytes."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer
        self.text = True

    @classmethod
    async def open(cls, port: int) -> Wire:
        reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=16 * 1024 * 1024)
        return cls(reader, writer)

    async def upgrade(self, *, text: bool, named: bool = True) -> int:
        """Send a valid handshake and return the HTTP status of the response."""
        self.text = text
        await self.write(request(PROTOCOLS[text] if named or not text else None))
        return int((await self.response()).split()[1])

    async def response(self) -> bytes:
        """Return the head of an HTTP response; raise `Closed` if the server closes instead."""
        try:
            return await self._reader.readuntil(b"\r\n\r\n")
        except (asyncio.IncompleteReadError, ConnectionError):
            raise Closed from None

    async def write(self, data: bytes) -> None:
        """Send bytes; raise `Closed` if the connection is closed."""
        try:
            self._writer.write(data)
            await self._writer.drain()
        except (ConnectionError, RuntimeError):
            raise Closed from None

    def encode(self, message: Any) -> bytes:
        """Return a message as a frame of this connection's subprotocol."""
        if self.text:
            return frame(json.dumps(message).encode(), TEXT)
        return frame(msgpack.packb(message), BINARY)

    async def ask(self, message: dict[str, Any], ref: int) -> dict[str, Any]:
        """Send a message and return its reply, skipping other messages."""
        await self.write(self.encode({**message, "ref": ref}))
        async for answer in self.messages():
            if answer.get("ref") == ref:
                return answer
        raise Closed

    async def messages(self) -> AsyncIterator[dict[str, Any]]:
        """Yield the server's messages; raise `Closed` when it closes."""
        while True:
            opcode, payload = await self._frame()
            if opcode == CLOSE:
                raise Closed(struct.unpack(">H", payload[:2])[0] if payload else None)
            if opcode in (TEXT, BINARY):
                yield json.loads(payload) if opcode == TEXT else msgpack.unpackb(payload)

    async def _frame(self) -> tuple[int, bytes]:
        try:
            first, size = await self._reader.readexactly(2)
            assert not size & 0x80, "servers must not mask frames"
            if size == 126:
                (size,) = struct.unpack(">H", await self._reader.readexactly(2))
            elif size == 127:
                (size,) = struct.unpack(">Q", await self._reader.readexactly(8))
            return first & 0x0F, await self._reader.readexactly(size)
        except (asyncio.IncompleteReadError, ConnectionError):
            raise Closed from None

    def cut(self) -> None:
        """Abort the connection without a close frame."""
        self._writer.transport.abort()

    async def close(self) -> None:
        """Close the connection with a FIN."""
        self._writer.close()
        try:
            await self._writer.wait_closed()
        except ConnectionError:
            return
