"""Connections of clients to servers that misbehave."""

from __future__ import annotations

import asyncio
import socket

import pytest
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from robotouille.protocol.codec import MSGPACK
from robotouille_client import sockets
from robotouille_client.sockets import open_game_socket

PINGS = (b"\x89\x7d" + b"p" * 125) * 500
MANY = 32 * 2**20


async def test_connection_is_cut_if_the_server_reads_no_pongs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sockets, "MAX_UNSENT_BYTES", 1000)
    sent = 0

    async def flood(connection: ServerConnection) -> None:
        nonlocal sent
        transport = connection.transport
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        transport.pause_reading()
        while sent < MANY and not transport.is_closing():
            if transport.get_write_buffer_size() < len(PINGS):
                transport.write(PINGS)
                sent += len(PINGS)
            await asyncio.sleep(0)
        transport.abort()

    async with serve(flood, "127.0.0.1", 0, subprotocols=[Subprotocol(MSGPACK.name)]) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        connection = await open_game_socket(f"ws://127.0.0.1:{port}", MSGPACK, 5, ())
        with pytest.raises(ConnectionClosed):
            await connection.recv()
    assert sent < MANY
