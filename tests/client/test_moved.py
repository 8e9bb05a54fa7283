"""Redirects to other processes and to other hosts."""

from __future__ import annotations

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

from robotouille_client import connect
from robotouille_client.errors import UntrustedRedirectError
from tests.support.virtual_time import virtual

NOBODY = 9
"""A port on which nothing listens."""
WELCOME = {"type": "welcome", "protocol": 1, "server": "x", "session": "s", "resume": "r",
           "role": "host", "grace": 1.0}  # fmt: skip


@asynccontextmanager
async def answering(**answers: dict[str, Any]) -> AsyncIterator[int]:
    """Serve a fixed answer for each type of message and yield the port."""

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


@asynccontextmanager
async def strangers() -> AsyncIterator[tuple[str, list[dict[str, Any]]]]:
    """Serve on another host name of this machine, and yield the URL and the received messages."""
    received: list[dict[str, Any]] = []

    async def converse(socket: ServerConnection) -> None:
        async for payload in socket:
            received.append(json.loads(payload))
            await socket.send(json.dumps(WELCOME))

    subprotocols = [Subprotocol("robotouille.v1.json")]
    async with listen(converse, "localhost", 0, subprotocols=subprotocols) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        yield f"ws://localhost:{port}", received


@virtual
async def test_redirected_join_sends_no_token_to_another_host() -> None:
    async with strangers() as (elsewhere, received):
        moved = {**moved_to(NOBODY), "url": elsewhere}
        async with (
            answering(hello=WELCOME, join=moved) as port,
            connect(
                f"ws://127.0.0.1:{port}", name="ada", encoding="json", token="secret"
            ) as client,
        ):
            with pytest.raises(
                UntrustedRedirectError, match="another host, 'localhost', and tokens are"
            ):
                await client.join("abc")
            assert client.url == f"ws://127.0.0.1:{port}"
        assert received == []


@virtual
async def test_redirected_hello_sends_no_token_to_another_host() -> None:
    async with strangers() as (elsewhere, received):
        async with answering(hello={**moved_to(NOBODY), "url": elsewhere}) as port:
            url = f"ws://127.0.0.1:{port}"
            with pytest.raises(UntrustedRedirectError, match="another host"):
                async with connect(url, name="ada", encoding="json", resume="secret"):
                    raise AssertionError("not reached")
        assert received == []


@virtual
async def test_http_redirect_sends_no_token_to_another_host() -> None:
    async with strangers() as (elsewhere, received):

        def redirect(socket: ServerConnection, request: Request) -> Response:
            response = socket.respond(http.HTTPStatus.FOUND, "")
            response.headers["Location"] = f"{elsewhere}{request.path}"
            return response

        async with listen(_silence, "127.0.0.1", 0, process_request=redirect) as server:
            port = next(iter(server.sockets)).getsockname()[1]
            with pytest.raises(UntrustedRedirectError, match="another host"):
                async with connect(f"ws://127.0.0.1:{port}", name="ada", token="secret"):
                    raise AssertionError("not reached")
        assert received == []


async def _silence(socket: ServerConnection) -> None:
    await socket.wait_closed()
