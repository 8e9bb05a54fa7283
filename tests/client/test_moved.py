"""The client library is sent to another process of the server, which will not have it."""

from __future__ import annotations

import asyncio
import http
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as listen
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from robotouille.protocol import messages
from robotouille_client import connect
from robotouille_client.errors import ConnectionFailedError, StrangerError
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


@asynccontextmanager
async def strangers() -> AsyncIterator[tuple[str, list[dict[str, Any]]]]:
    """A server on another host (the same machine by another name): its URL, and what it hears."""
    heard: list[dict[str, Any]] = []

    async def converse(socket: ServerConnection) -> None:
        async for payload in socket:
            heard.append(json.loads(payload))
            await socket.send(json.dumps(WELCOME))

    subprotocols = [Subprotocol("robotouille.v1.json")]
    async with listen(converse, "localhost", 0, subprotocols=subprotocols) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        yield f"ws://localhost:{port}", heard


def test_no_token_goes_to_another_host_that_a_join_is_sent_to() -> None:
    async def main() -> None:
        async with strangers() as (elsewhere, heard):
            moved = {**moved_to(NOBODY), "url": elsewhere}
            async with (
                answering(hello=WELCOME, join=moved) as port,
                connect(
                    f"ws://127.0.0.1:{port}", name="ada", encoding="json", token="secret"
                ) as client,
            ):
                with pytest.raises(StrangerError, match="'localhost', another host: tokens are"):
                    await client.join("abc")
                assert client.url == f"ws://127.0.0.1:{port}"
            assert heard == []

    run(main())


def test_no_token_goes_to_another_host_that_a_hello_is_sent_to() -> None:
    async def main() -> None:
        async with strangers() as (elsewhere, heard):
            async with answering(hello={**moved_to(NOBODY), "url": elsewhere}) as port:
                url = f"ws://127.0.0.1:{port}"
                with pytest.raises(StrangerError, match="another host"):
                    async with connect(url, name="ada", encoding="json", resume="secret"):
                        raise AssertionError("not reached")
            assert heard == []

    run(main())


def test_no_token_goes_where_an_http_redirect_leads() -> None:
    async def main() -> None:
        async with strangers() as (elsewhere, heard):

            def redirect(socket: ServerConnection, request: Request) -> Response:
                response = socket.respond(http.HTTPStatus.FOUND, "")
                response.headers["Location"] = f"{elsewhere}{request.path}"
                return response

            async with listen(_silence, "127.0.0.1", 0, process_request=redirect) as server:
                port = next(iter(server.sockets)).getsockname()[1]
                with pytest.raises(StrangerError, match="another host"):
                    async with connect(f"ws://127.0.0.1:{port}", name="ada", token="secret"):
                        raise AssertionError("not reached")
            assert heard == []

    run(main())


async def _silence(socket: ServerConnection) -> None:
    await socket.wait_closed()


def test_a_client_that_comes_back_and_is_sent_to_strangers_gives_up() -> None:
    async def main() -> None:
        async with strangers() as (elsewhere, heard):
            stranger = {**moved_to(NOBODY), "url": elsewhere}
            async with (
                answering(hello=WELCOME, join=stranger) as port,
                connect(
                    f"ws://127.0.0.1:{port}", name="ada", encoding="json", token="secret"
                ) as client,
            ):
                client.protocol.membership = messages.Join(episode="x")
                assert client._socket is not None
                client._socket.transport.abort()
                async with asyncio.timeout(600):
                    while not client.farewell:
                        await asyncio.sleep(0.1)
                assert "another host" in client.farewell
            assert heard == []

    run(main())
