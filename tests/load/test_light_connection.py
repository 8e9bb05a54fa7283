"""The connection that costs next to nothing is still a WebSocket connection."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.asyncio.server import ServerConnection, serve
from websockets.frames import Frame, Opcode
from websockets.typing import Subprotocol

from robotouille.protocol.codec import MSGPACK
from robotouille_client.loadtest.worker.light_connection import (
    HandshakeRefusedError,
    LightConnection,
    Traffic,
    UnreachableError,
    open_connection,
)
from robotouille_client.sockets import server_uri
from tests.support.servers import serving
from tests.support.virtual_time import run

URL = "ws://127.0.0.1:1"


@st.composite
def streams(draw: Any) -> tuple[list[bytes], bytes, list[int]]:
    """Messages, the frames that carry them (whole or in parts), and where reads end."""
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
def test_messages_arrive_however_the_stream_is_cut(
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
    """A server of the library that sends everything back."""

    async def echo(socket: ServerConnection) -> None:
        async for message in socket:
            await socket.send(message)

    async with serve(echo, "127.0.0.1", 0, **options) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        yield f"ws://127.0.0.1:{port}"


PROTOCOL: dict[str, Any] = {"subprotocols": [Subprotocol(MSGPACK.name)]}


def test_the_library_understands_what_is_sent_and_counts_agree() -> None:
    async def converse() -> None:
        async with echoing(max_size=None, **PROTOCOL) as url:
            traffic = Traffic()
            connection = await open_connection(server_uri(url), traffic, 5)
            received: asyncio.Queue[bytes] = asyncio.Queue()
            connection.receive = received.put_nowait
            for size in (1, 100, 200, 70_000):
                message = {"type": "echo", "content": "x" * size}
                connection.send(message)
                assert msgpack.unpackb(await received.get()) == message
            ponged = asyncio.Event()
            connection.ponged = ponged.set
            connection.ping()
            await ponged.wait()
            assert (traffic.messages_in, traffic.messages_out) == (4, 4)
            assert min(traffic.bytes_in, traffic.bytes_out) > 70_000

    run(converse())


def test_pings_of_the_server_are_answered_and_a_close_is_noticed() -> None:
    async def converse() -> None:
        answered = asyncio.Event()

        async def handle(socket: ServerConnection) -> None:
            await (await socket.ping())
            answered.set()
            await socket.close(1000)

        async with serve(handle, "127.0.0.1", 0, **PROTOCOL) as server:
            port = next(iter(server.sockets)).getsockname()[1]
            connection = await open_connection(server_uri(f"ws://127.0.0.1:{port}"), Traffic(), 5)
            lost = asyncio.Event()
            connection.lost = lost.set
            await answered.wait()
            await lost.wait()
            connection.send({"type": "too late"})
            await asyncio.sleep(1)

    run(converse())


def test_a_server_that_refuses_is_quoted(tmp_path: Path) -> None:
    async def knock() -> None:
        async with serving(tmp_path, max_connections=1) as server:
            first = await open_connection(server_uri(server.url), Traffic(), 5)
            with pytest.raises(HandshakeRefusedError, match=r"503 .*: the server is full"):
                await open_connection(server_uri(server.url), Traffic(), 5)
            first.close()

    run(knock())


def test_other_servers_are_told_apart() -> None:
    async def knock() -> None:
        async with echoing() as url:
            with pytest.raises(
                HandshakeRefusedError, match=r"does not speak robotouille\.v1\.msgpack"
            ):
                await open_connection(server_uri(url), Traffic(), 5)

        async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            await reader.readuntil(b"\r\n\r\n")
            writer.write(b"220 mail.example ESMTP\r\n\r\n")
            await reader.read()
            writer.close()

        mail = await asyncio.start_server(answer, "127.0.0.1", 0)
        port = mail.sockets[0].getsockname()[1]
        with pytest.raises(
            HandshakeRefusedError, match=r"'220 mail\.example ESMTP', which opens no"
        ):
            await open_connection(server_uri(f"ws://127.0.0.1:{port}"), Traffic(), 5)
        mail.close()
        await asyncio.sleep(1)

    run(knock())


def test_nobody_there_and_nobody_who_answers() -> None:
    async def knock() -> None:
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

    run(knock())
