"""The client library is sent to another process of the server, which will not have it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as listen
from websockets.typing import Subprotocol

from robotouille_client import connect
from robotouille_client.connection import ConnectionFailedError
from tests.support.virtual_time import run

NOBODY = 9
"""A port on which nothing listens."""
WELCOME = {"type": "welcome", "protocol": 1, "server": "x", "session": "s", "resume": "r",
           "role": "host", "grace": 1.0}  # fmt: skip


@asynccontextmanager
async def answering(**answers: dict[str, Any]) -> AsyncIterator[int]:
    """A server that answers each type of message always alike; its port."""

    async def converse(socket: ServerConnection) -> None:
        async for payload in socket:
            message = json.loads(payload)
            answer = answers.get(message["type"])
            if answer is not None:
                ref = {"ref": message["ref"]} if "ref" in message else {}
                await socket.send(json.dumps({**answer, **ref}))

    subprotocols = [Subprotocol("robotouille.v1.json")]
    async with listen(converse, "127.0.0.1", 0, subprotocols=subprotocols) as server:
        yield next(iter(server.sockets)).getsockname()[1]


def moved_to(port: int) -> dict[str, Any]:
    return {"type": "moved", "episode": "x", "port": port}


def test_a_join_that_is_sent_to_where_nobody_is_fails() -> None:
    async def main() -> None:
        async with (
            answering(hello=WELCOME, join=moved_to(NOBODY)) as port,
            connect(
                f"ws://127.0.0.1:{port}", name="ada", encoding="json", reconnect=False
            ) as client,
        ):
            async with asyncio.timeout(600):
                with pytest.raises(ConnectionFailedError, match=r":9, where the episode is"):
                    await client.join("abc")

    run(main())


def test_a_join_that_is_sent_to_where_we_are_refused_says_why() -> None:
    async def main() -> None:
        refusal = {
            "type": "error",
            "code": "auth/required",
            "message": "this server asks for a token",
        }
        async with (
            answering(hello=refusal) as second,
            answering(hello=WELCOME, join=moved_to(second)) as first,
            connect(f"ws://127.0.0.1:{first}", name="ada", encoding="json") as client,
        ):
            async with asyncio.timeout(600):
                with pytest.raises(ConnectionFailedError, match="asks for a token"):
                    await client.join("abc")

    run(main())
