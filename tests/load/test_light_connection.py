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

from robotouille_client.loadtest.light_connection import (
    HandshakeRefusedError,
    LightConnection,
    Traffic,
    UnreachableError,
    open_connection,
)
from robotouille_client.sockets import server_uri
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
