"""Servers and raw connections in virtual time."""

from __future__ import annotations

import json
import random
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import msgpack
from websockets import Subprotocol
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as open_socket

from robotouille.protocol.codec import JSON, MSGPACK
from robotouille_client import connect
from robotouille_server import Server, ServerSettings, serve
from robotouille_server.app import Surroundings
from robotouille_server.rooms.recording.storage import Storage
from robotouille_server.rooms.substitutes.bot_worker import BotWorker, ThreadBotWorker
from robotouille_server.runtime.logs import configure_logs
from tests.support.executors import ImmediateExecutor

configure_logs("error", "console")

STAMP = "20260101T000000Z"


@asynccontextmanager
async def serving(
    folder: Path,
    *,
    seed: int = 1,
    port: int = 0,
    storage: Storage | None = None,
    wall: Callable[[], float] = time.time,
    bot_worker: Callable[[], BotWorker] = lambda: ThreadBotWorker(ImmediateExecutor()),
    **options: Any,
) -> AsyncIterator[Server]:
    """Run a server on a free port with fixed ids, codes and timestamps. Substitutes plan without
    using virtual time.
    """
    settings = ServerSettings(port=port, recordings=folder, **{"countdown": 0.0, **options})
    around = Surroundings(
        randomness=random.Random(seed),
        timestamp=lambda: STAMP,
        storage=storage,
        wall=wall,
        bot_worker=bot_worker,
    )
    async with serve(settings, around) as server:
        yield server


@asynccontextmanager
async def with_clients(folder: Path, *names: str, **options: Any) -> AsyncIterator[tuple[Any, ...]]:
    """Run a server with a client of each name; yield the server and the clients."""
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(serving(folder, **options))
        clients = [
            await stack.enter_async_context(connect(server.url, name=name)) for name in names
        ]
        yield server, *clients


async def crash(server: Server) -> None:
    """Stop a server like `kill -9`: it sends and writes nothing more."""
    server.shutdown.begun = True
    for room in list(server.lobby.rooms.values()):
        room.suspend()
    server.listener.refuse()
    for connection in list(server.connections.open):
        connection.abort()
    await server.admission.wait_empty()


class Raw:
    """WebSocket that sends and receives raw protocol messages."""

    def __init__(self, socket: ClientConnection, text: bool) -> None:
        self.socket = socket
        self.text = text

    async def send(self, message: Any) -> None:
        await self.socket.send(json.dumps(message) if self.text else msgpack.packb(message))

    async def receive(self) -> dict[str, Any]:
        payload = await self.socket.recv()
        plain: dict[str, Any] = (
            json.loads(payload) if isinstance(payload, str) else msgpack.unpackb(payload)
        )
        return plain

    async def expect(self, *kinds: str) -> dict[str, Any]:
        """Return the next message of one of these types, skipping others."""
        while True:
            message = await self.receive()
            if message["type"] in kinds:
                return message

    async def ask(self, message: Any, *kinds: str) -> dict[str, Any]:
        await self.send(message)
        return await self.expect(*kinds, "error")


@asynccontextmanager
async def raw(
    server: Server, *, text: bool = True, hello: bool = True, name: str = "raw"
) -> AsyncIterator[Raw]:
    """Open a raw connection and, by default, send `hello`."""
    codec = JSON if text else MSGPACK
    async with open_socket(
        server.url,
        subprotocols=[Subprotocol(codec.name)],
        max_size=None,
        compression=None,
    ) as socket:
        connection = Raw(socket, text)
        if hello:
            answer = await connection.ask({"type": "hello", "protocol": 1, "name": name}, "welcome")
            assert answer["type"] == "welcome", answer
        yield connection
