"""The light connection follows the WebSocket protocol."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.asyncio.server import ServerConnection, serve
from websockets.frames import Frame, Opcode

from robotouille.protocol.codec import MAX_SERVER_BYTES
from robotouille_client.loadtest.light_connection import (
    MAX_FRAGMENTS,
    MAX_HEAD_BYTES,
    HandshakeRefusedError,
    LightConnection,
    Traffic,
    UnreachableError,
    open_connection,
)
from robotouille_client.sockets import MAX_UNSENT_BYTES, server_uri
from robotouille_server import Server
from tests.support.servers import serving
from tests.support.virtual_time import opening, virtual

URL = "ws://127.0.0.1:1"


@st.composite
def streams(draw: Any) -> tuple[list[bytes], bytes, list[int]]:
    """Draw messages, their frames (whole or fragmented) and the ends of reads."""
    messages, stream = [], b""
    sizes = st.sampled_from([0, 1, 125, 126, 127, 65_535, 65_536, 70_000])
    for size in draw(st.lists(sizes, max_size=6)):
        message = bytes(draw(st.integers(0, 255)) for _ in range(min(size, 3))).ljust(size, b"x")
        messages.append(message)
        cut = draw(st.integers(0, size))
        if draw(st.booleans()):
            parts = [(Opcode.BINARY, message[:cut], False), (Opcode.CONT, message[cut:], True)]
        else:
            parts = [(Opcode.BINARY, message, True)]
        for number, (code, data, last) in enumerate(parts):
            if number:
                stream += Frame(Opcode.PONG, b"between").serialize(mask=False)
            stream += Frame(code, data, last).serialize(mask=False)
    ends = draw(st.lists(st.integers(0, len(stream)), max_size=8).map(sorted))
    return messages, stream, ends


@settings(deadline=None)
@given(streams())
def test_messages_arrive_from_any_split_of_the_stream(
    stream: tuple[list[bytes], bytes, list[int]],
) -> None:
    messages, content, ends = stream

    async def read() -> list[bytes]:
        connection = LightConnection(server_uri(URL), Traffic())
        connection.opened.set_result(None)
        received: list[bytes] = []
        connection.receive = received.append
        for start, end in zip([0, *ends], [*ends, len(content)], strict=True):
            connection.data_received(content[start:end])
        return received

    assert asyncio.run(read()) == messages


class Unread(asyncio.Transport):
    """Transport to a server that reads nothing. `unsent` is all that was written."""

    def __init__(self) -> None:
        super().__init__()
        self.unsent = 0
        self.aborted = False

    def write(self, data: Any) -> None:
        self.unsent += len(data)

    def get_write_buffer_size(self) -> int:
        return self.unsent

    def is_closing(self) -> bool:
        return self.aborted

    def abort(self) -> None:
        self.aborted = True


async def opened() -> tuple[LightConnection, Unread]:
    connection, transport = LightConnection(server_uri(URL), Traffic()), Unread()
    connection.connection_made(transport)
    connection.opened.set_result(None)
    transport.unsent = 0
    return connection, transport


@pytest.mark.parametrize("size", [0, 1, 60_000])
async def test_endless_message_cuts_the_connection(size: int) -> None:
    connection, transport = await opened()
    messages: list[bytes] = []
    connection.receive = messages.append
    limit = min(MAX_FRAGMENTS, MAX_SERVER_BYTES // max(size, 1))
    part = Frame(Opcode.CONT, b"x" * size, fin=False).serialize(mask=False)
    connection.data_received(Frame(Opcode.BINARY, b"", fin=False).serialize(mask=False))
    for _ in range(limit - 1):
        connection.data_received(part)
    assert not transport.aborted
    for _ in range(2):
        connection.data_received(part)
    assert transport.aborted
    assert messages == []


async def test_unread_pongs_cut_the_connection() -> None:
    connection, transport = await opened()
    pings = Frame(Opcode.PING, b"x" * 125).serialize(mask=False) * 500
    for _ in range(100):
        connection.data_received(pings)
    assert transport.aborted
    assert transport.unsent < MAX_UNSENT_BYTES + 1000


async def test_endless_head_is_refused() -> None:
    connection, transport = LightConnection(server_uri(URL), Traffic()), Unread()
    connection.connection_made(transport)
    for _ in range(MAX_HEAD_BYTES // 4096 + 1):
        connection.data_received(b"x" * 4096)
    assert transport.aborted
    with pytest.raises(HandshakeRefusedError, match="sends more than 65,536 bytes"):
        await connection.opened


@asynccontextmanager
async def echoing(**options: Any) -> AsyncIterator[str]:
    """Serve with the library, sending everything back, and yield the URL."""

    async def echo(socket: ServerConnection) -> None:
        async for message in socket:
            await socket.send(message)

    async with serve(echo, "127.0.0.1", 0, **options) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        yield f"ws://127.0.0.1:{port}"


@opening(serving, max_connections=1)
async def test_refusal_quotes_the_server(server: Server) -> None:
    first = await open_connection(server_uri(server.url), Traffic(), 5)
    with pytest.raises(HandshakeRefusedError, match=r"503 .*: the server is full"):
        await open_connection(server_uri(server.url), Traffic(), 5)
    first.close()


@virtual
async def test_other_kinds_of_servers_are_recognized() -> None:
    async with echoing() as url:
        with pytest.raises(HandshakeRefusedError, match=r"does not speak robotouille\.v1\.msgpack"):
            await open_connection(server_uri(url), Traffic(), 5)

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(b"220 mail.example ESMTP\r\n\r\n")
        await reader.read()
        writer.close()

    mail = await asyncio.start_server(answer, "127.0.0.1", 0)
    port = mail.sockets[0].getsockname()[1]
    with pytest.raises(HandshakeRefusedError, match=r"'220 mail\.example ESMTP', which is not"):
        await open_connection(server_uri(f"ws://127.0.0.1:{port}"), Traffic(), 5)
    mail.close()
    await asyncio.sleep(1)


@virtual
async def test_silent_and_missing_servers_are_unreachable() -> None:
    async def listen(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read()
        writer.close()

    silent = await asyncio.start_server(listen, "127.0.0.1", 0)
    port = silent.sockets[0].getsockname()[1]
    with pytest.raises(UnreachableError, match=f"127.0.0.1:{port} did not answer in 5 s"):
        await open_connection(server_uri(f"ws://127.0.0.1:{port}"), Traffic(), 5)
    silent.close()
    await asyncio.sleep(1)
    with pytest.raises(UnreachableError, match=f"no server at 127.0.0.1:{port}"):
        await open_connection(server_uri(f"ws://127.0.0.1:{port}"), Traffic(), 5)
