"""Redirects to other processes and to other hosts."""

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

from robotouille_client import connect
from robotouille_client.errors import ConnectionFailedError, UntrustedRedirectError
from tests.support.virtual_time import virtual

NOBODY = 9
"""A port on which nothing listens."""
WELCOME = {"type": "welcome", "protocol": 1, "server": "x", "session": "s", "resume": "r",
           "role": "host", "grace": 1.0}  # fmt: skip
EPISODES = {"type": "episodes", "episodes": []}


@asynccontextmanager
async def answering(**answers: dict[str, Any]) -> AsyncIterator[int]:
    """Serve a fixed answer for each type of message and yield the port."""

    async def converse(socket: ServerConnection) -> None:
        async for payload in socket:
            message = json.loads(payload)
            answer = answers.get(message["type"])
            if answer is not None:
                ref = {"ref": message["ref"]} if "ref" in message else {}
                await socket.send(json.dumps({**ref, **answer}))

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


@asynccontextmanager
async def redirecting(elsewhere: str) -> AsyncIterator[str]:
    """Yield the URL of a server that redirects connections by HTTP."""

    def redirect(socket: ServerConnection, request: Request) -> Response:
        response = socket.respond(http.HTTPStatus.FOUND, "")
        response.headers["Location"] = f"{elsewhere}{request.path}"
        return response

    async with listen(_silence, "127.0.0.1", 0, process_request=redirect) as server:
        yield f"ws://127.0.0.1:{next(iter(server.sockets)).getsockname()[1]}"


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
    async with strangers() as (elsewhere, received), redirecting(elsewhere) as url:
        with pytest.raises(UntrustedRedirectError, match="another host"):
            async with connect(url, name="ada", token="secret"):
                raise AssertionError("not reached")
        assert received == []


@virtual
async def test_http_redirect_to_a_named_host_is_followed() -> None:
    async with strangers() as (elsewhere, received), redirecting(elsewhere) as url:
        async with connect(f"{url},{elsewhere}", name="ada", token="secret", encoding="json"):
            assert [message["token"] for message in received] == ["secret"]


@virtual
async def test_one_living_node_of_those_named_is_enough() -> None:
    async with answering(hello=WELCOME, list=EPISODES) as port:
        living = f"ws://127.0.0.1:{port}"
        for urls in (f"ws://127.0.0.1:{NOBODY},{living}", f"{living},ws://127.0.0.1:{NOBODY}"):
            async with connect(urls, name="ada", encoding="json") as client:
                assert client.url == living
                assert await client.episodes() == []


@virtual
async def test_every_named_address_is_checked_before_connecting() -> None:
    async with answering(hello=WELCOME) as port:
        with pytest.raises(ConnectionFailedError, match="a port is a number from 1 to 65535"):
            async with connect(f"ws://127.0.0.1:{port},ws://b:0", name="ada", encoding="json"):
                raise AssertionError("not reached")


@virtual
async def test_moved_episode_is_resumed_over_a_new_connection() -> None:
    moved = {"type": "moved", "episode": "x", "port": 1}
    async with answering(hello={**WELCOME, "server": "new"}, list=EPISODES) as there:
        url = f"ws://127.0.0.1:{there}"
        async with (
            answering(hello=WELCOME, get_rendering={**moved, "url": url, "ref": None}) as here,
            connect(f"ws://127.0.0.1:{here}", name="ada", encoding="json") as client,
        ):
            rendering = asyncio.create_task(client.rendering())
            assert await client.episodes() == []
            assert client.url == url
            rendering.cancel()


@virtual
async def test_client_does_not_wait_for_the_end_of_its_old_connection() -> None:
    sockets: list[ServerConnection] = []

    async def move(socket: ServerConnection) -> None:
        sockets.append(socket)
        await socket.recv()
        await socket.send(json.dumps(WELCOME))
        await socket.recv()
        await socket.send(json.dumps({"type": "moved", "episode": "x", "port": 1, "url": url}))
        socket.transport.pause_reading()
        await socket.wait_closed()

    subprotocols = [Subprotocol("robotouille.v1.json")]
    async with answering(hello={**WELCOME, "server": "new"}, list=EPISODES) as there:
        url = f"ws://127.0.0.1:{there}"
        async with (
            listen(move, "127.0.0.1", 0, subprotocols=subprotocols) as server,
            connect(
                f"ws://127.0.0.1:{next(iter(server.sockets)).getsockname()[1]}",
                name="ada",
                encoding="json",
            ) as client,
        ):
            async with asyncio.timeout(1):
                assert await client.episodes() == []
            assert client.url == url
            sockets[0].transport.abort()


@virtual
async def test_client_leaves_a_node_that_falls_silent() -> None:
    sockets: list[ServerConnection] = []

    async def fall_silent(socket: ServerConnection) -> None:
        sockets.append(socket)
        await socket.recv()
        await socket.send(json.dumps({**WELCOME, "nodes": [other]}))
        await asyncio.sleep(30)
        server.close(close_connections=False)
        socket.transport.pause_reading()
        await socket.wait_closed()

    subprotocols = [Subprotocol("robotouille.v1.json")]
    async with answering(hello=WELCOME, list=EPISODES) as port:
        other = f"ws://127.0.0.1:{port}"
        async with (
            listen(
                fall_silent, "127.0.0.1", 0, subprotocols=subprotocols, ping_interval=None
            ) as server,
            connect(
                f"ws://127.0.0.1:{next(iter(server.sockets)).getsockname()[1]}",
                name="ada",
                encoding="json",
            ) as client,
        ):
            await asyncio.sleep(60)
            url = client.url
            sockets[0].transport.abort()
            assert url == other
            assert client.connected.is_set()


async def _silence(socket: ServerConnection) -> None:
    await socket.wait_closed()
