"""The HTTP service: shutdown and incomplete requests."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from mcp import MCPError

from robotouille.web.bounded_requests import MAX_HEAD_LINES
from robotouille_client.mcp_server import http
from robotouille_client.mcp_server.http import PATH, HttpService, http_app, listening_socket
from robotouille_client.mcp_server.open_games import OpenGames
from robotouille_client.mcp_server.server import mcp_server
from robotouille_server import Server
from tests.support.mcp_agent import Agent, over
from tests.support.servers import serving


@asynccontextmanager
async def playing(server: Server) -> AsyncIterator[tuple[Agent, OpenGames, HttpService]]:
    """Yield an agent that plays over HTTP, the open games and the service, which stops at exit."""
    games = OpenGames(server.url)
    app = http_app(mcp_server(lambda: games), games, idle_seconds=600)
    with listening_socket("127.0.0.1", 0) as listening:
        service = HttpService(app, games)
        serving_http = asyncio.create_task(service.serve(sockets=[listening]))
        async with over(f"http://127.0.0.1:{listening.getsockname()[1]}{PATH}") as agent:
            yield agent, games, service
        service.should_exit = True
        await serving_http


async def test_stopped_service_answers_waiting_calls(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        async with playing(server) as (ada, games, service):
            view = await ada.call("join", episode=await ada.opened("multi_agent/01"))
            waiting = asyncio.create_task(ada.call("wait", game=view["game"], timeout_seconds=60))
            (opened,) = games._games.values()
            while not opened.calls:
                await asyncio.sleep(0)
            service.should_exit = True
            assert "out of the episode" in (await waiting)["next"]
        (room,) = server.lobby.rooms.values()
        assert not room.members


async def test_failed_requests_fill_no_log(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with serving(tmp_path) as server, playing(server) as (ada, _, _):
        with pytest.raises(MCPError, match="error"):
            await ada.client.get_prompt("no such prompt")
    assert not [
        each for each in caplog.records if each.name.startswith(("mcp.server", "mcp.shared"))
    ]


HEAD = b"POST /mcp HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-length: 50\r\n\r\n{"


@pytest.mark.parametrize(
    ("sent", "answer"),
    [(b"", b""), (b"POST /mcp HT", b""), (HEAD, b"HTTP/1.1 408")],
    ids=["silent", "half a head", "half a body"],
)
async def test_incomplete_requests_are_cut_off(
    monkeypatch: pytest.MonkeyPatch, sent: bytes, answer: bytes
) -> None:
    monkeypatch.setattr(http, "REQUEST_SECONDS", 0.05)
    received = await answered(sent)
    assert received.startswith(answer)
    assert bool(received) == bool(answer)


async def test_burst_of_connections_leaves_turns_to_others() -> None:
    games = OpenGames("ws://127.0.0.1:9")
    app = http_app(mcp_server(lambda: games), games, idle_seconds=600)
    with listening_socket("127.0.0.1", 0) as listening:
        service = HttpService(app, games)
        serving_http = asyncio.create_task(service.serve(sockets=[listening]))
        while not service.started:
            await asyncio.sleep(0)
        count, turns = 20 * http.ACCEPTED_AT_ONCE, 0
        # All of them connect, before the service has accepted the first one.
        burst = [socket.create_connection(listening.getsockname(), 5) for _ in range(count)]
        while len(service.server_state.connections) < count:
            await asyncio.sleep(0)
            turns += 1
        assert turns >= 20
        for one in burst:
            one.close()
        service.should_exit = True
        await serving_http


CHUNKED = HEAD.partition(b"content")[0] + b"transfer-encoding: chunked\r\n\r\n" + b"1\r\na\r\n" * 9
MANY_LINES = HEAD.partition(b"\r\n\r\n")[0] + b"\r\na:" * MAX_HEAD_LINES + b"\r\n\r\n"


@pytest.mark.parametrize("sent", [CHUNKED, MANY_LINES], ids=["chunks", "lines"])
async def test_costly_requests_of_strangers_are_refused_and_fill_no_log(
    sent: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    assert (await answered(sent)).startswith(b"HTTP/1.1 400")
    assert not capfd.readouterr().err


async def answered(sent: bytes) -> bytes:
    """Return what the service answers to some bytes, before it closes the connection."""
    games = OpenGames("ws://127.0.0.1:9")
    app = http_app(mcp_server(lambda: games), games, idle_seconds=600)
    with listening_socket("127.0.0.1", 0) as listening:
        service = HttpService(app, games)
        serving_http = asyncio.create_task(service.serve(sockets=[listening]))
        reader, writer = await asyncio.open_connection(*listening.getsockname())
        writer.write(sent)
        try:
            received = await asyncio.wait_for(reader.read(), 10)
        except ConnectionResetError:
            received = b""
        writer.close()
        service.should_exit = True
        await serving_http
    return received
