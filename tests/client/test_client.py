"""Sockets, futures and timers of the asyncio client."""

from __future__ import annotations

import asyncio
import json
import socket
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest
from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as listen
from websockets.datastructures import Headers
from websockets.exceptions import InvalidMessage, InvalidStatus
from websockets.http11 import Response
from websockets.typing import Subprotocol

from robotouille import ProtocolError, WrongArgumentError
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON
from robotouille_client import Client, ConnectionFailedError, connect
from robotouille_client import client as client_module
from robotouille_client.errors import UntrustedRedirectError
from robotouille_client.sansio.client_state import ClientState
from robotouille_client.sockets import connection_error, open_socket
from tests.support.scripted_server import ScriptedServer
from tests.support.virtual_time import virtual

Converse = Callable[[ServerConnection], Awaitable[None]]
WELCOME = JSON.encode(ScriptedServer().welcome())


@asynccontextmanager
async def listening(converse: Converse) -> AsyncIterator[str]:
    """Serve connections with `converse` and yield the URL."""
    subprotocols = [Subprotocol("robotouille.v1.json")]
    async with listen(converse, "127.0.0.1", 0, subprotocols=subprotocols) as server:
        yield f"ws://127.0.0.1:{next(iter(server.sockets)).getsockname()[1]}"


async def silent(socket: ServerConnection) -> None:
    await socket.wait_closed()


def answering(**answers: dict[str, Any]) -> Converse:
    async def converse(socket: ServerConnection) -> None:
        async for payload in socket:
            message = json.loads(payload)
            if message["type"] == "hello":
                await socket.send(answers.get("hello", WELCOME))  # type: ignore[arg-type]
            elif message["type"] in answers:
                await socket.send(json.dumps({**answers[message["type"]], "ref": message["ref"]}))

    return converse


def tasks() -> set[asyncio.Task[Any]]:
    return asyncio.all_tasks() - {asyncio.current_task()}  # type: ignore[arg-type]


@virtual
async def test_silent_server_times_out() -> None:
    async with listening(silent) as url:
        begun = asyncio.get_running_loop().time()
        with pytest.raises(ConnectionFailedError, match="did not welcome the client"):
            async with connect(url, name="ada", encoding="json"):
                raise AssertionError("not reached")
        assert 15 <= asyncio.get_running_loop().time() - begun < 20


@virtual
async def test_answer_of_the_wrong_type_is_an_error() -> None:
    left = {"type": "left", "episode": "x"}
    async with (
        listening(answering(list=left)) as url,
        connect(url, name="ada", encoding="json") as ada,
    ):
        with pytest.raises(ProtocolError, match="unexpected answer Left to list"):
            await ada.episodes()


@virtual
async def test_invalid_message_closes_the_client() -> None:
    async def converse(socket: ServerConnection) -> None:
        await socket.recv()
        await socket.send(WELCOME)
        await socket.send('{"type": "nonsense"}')
        await socket.wait_closed()

    async with listening(converse) as url, connect(url, name="ada", encoding="json") as ada:
        while not ada.farewell:
            await asyncio.sleep(0.1)
        assert ada.farewell.startswith("invalid message from the server: ")
        assert not ada.connected.is_set()
        with pytest.raises(ConnectionFailedError, match="invalid message"):
            await ada.episodes()


@pytest.mark.parametrize(
    "answer",
    [b"\x95\x00", "nonsense", '{"type": "nonsense"}', '{"type": "welcome", "protocol": 99}'],
)
@virtual
async def test_incompatible_server_is_named_by_its_url(answer: str | bytes) -> None:
    async def converse(socket: ServerConnection) -> None:
        await socket.recv()
        await socket.send(answer)
        await socket.wait_closed()

    async with listening(converse) as url:
        said = f"{url} is not a Robotouille server, or"
        with pytest.raises(ConnectionFailedError, match=said) as odd:
            async with connect(url, name="ada", encoding="json"):
                raise AssertionError("nobody is there")
        assert "message/" not in str(odd.value)


@virtual
async def test_closed_client_leaves_no_task_behind() -> None:
    async with listening(answering()) as url:
        before = tasks()
        client = Client(url, name="ada", codec=JSON)
        async with client:
            asking = asyncio.create_task(client.episodes())
            await asyncio.sleep(1)
            assert len(tasks()) > len(before) + 1
        with pytest.raises(ConnectionFailedError, match="the connection was closed"):
            await asking
        assert client.protocol.state is ClientState.CLOSED
        await asyncio.sleep(1)
        assert {t for t in tasks() if "robotouille" in t.get_name()} == set()


@virtual
async def test_connecting_can_be_cancelled() -> None:
    async with listening(silent) as url:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(1), connect(url, name="ada", encoding="json"):
                raise AssertionError("not reached")
        assert {t for t in tasks() if "robotouille" in t.get_name()} == set()


@pytest.mark.parametrize(("phases", "found"), [(["ended", "waiting", "waiting"], "K1"), ([], None)])
@virtual
async def test_waiting_episode_returns_the_first_waiting_one(
    phases: list[str], found: str | None
) -> None:
    row = {"task": "t", "clock": "turn", "step": 0, "max_steps": 9, "seats": []}
    rows = [
        {"episode": f"e{number}", "code": f"K{number}", "phase": phase, **row}
        for number, phase in enumerate(phases)
    ]
    listed = {"type": "episodes", "episodes": rows, "total": len(rows)}

    async with (
        listening(answering(list=listed)) as url,
        connect(url, name="ada", encoding="json") as client,
    ):
        waiting = await client.waiting_episode()
        assert (waiting and waiting.code) == found


HERE, SAFE = "ws://127.0.0.1:8765", "wss://kitchen.example"


def refused(body: bytes) -> InvalidStatus:
    return InvalidStatus(Response(503, "Service Unavailable", Headers(), body))


def untrusted(message: str) -> ssl.SSLCertVerificationError:
    error = ssl.SSLCertVerificationError(1, message)
    error.verify_message = message
    return error


@pytest.mark.parametrize(
    ("error", "url", "words"),
    [
        (refused(b"the server is full\nmore"), HERE, "the server is full"),
        (refused(b"<html>"), HERE, "it is a web page, not a Robotouille server"),
        (InvalidMessage("no HTTP response"), HERE, "If the server uses TLS, connect to wss://"),
        (untrusted("self-signed certificate"), SAFE, "SSL_CERT_FILE=FILE"),
        (untrusted("IP address mismatch, not valid for 'x'."), SAFE, "Use --url with a name"),
        (ConnectionResetError(), SAFE, "the handshake was cut off. If the server does not use TLS"),
        (ssl.SSLError(1, "wrong version"), SAFE, "connect to ws://"),
        (ConnectionRefusedError("refused"), HERE, f"no answer from {HERE}. Is a server running"),
        (OSError("Multiple exceptions: [Errno 111]"), HERE, f"no answer from {HERE}."),
        (TimeoutError(), HERE, f"no answer from {HERE}."),
        (socket.gaierror(-2, "unknown"), "ws://kitchn:1", "unknown host 'kitchn'"),
        (OSError("no route"), HERE, f"cannot connect to {HERE}: no route. Is robotouille-server"),
    ],
)
def test_connection_errors_are_explained(error: Exception, url: str, words: str) -> None:
    assert words in connection_error(error, url)


@pytest.mark.parametrize("there", ["ws://127.0.0.1:99999/", "ws://[::1/"])
def test_http_redirect_to_an_invalid_address_is_refused(there: str) -> None:
    moved = InvalidStatus(Response(302, "Found", Headers(Location=there)))
    with pytest.raises(UntrustedRedirectError, match="redirects to an invalid address"):
        open_socket(HERE).process_redirect(moved)


@pytest.mark.parametrize(("limit", "most"), [("MAX_LISTED", 250), ("MAX_LISTED_BYTES", 60_000)])
async def test_a_list_without_end_is_cut_off(
    monkeypatch: pytest.MonkeyPatch, limit: str, most: int
) -> None:
    monkeypatch.setattr(client_module, limit, most)
    client, sent = Client("ws://127.0.0.1:1", name="ada"), 0

    async def page(request: messages.ListEpisodes, kind: object) -> messages.Episodes:
        nonlocal sent
        sent += 1
        rows = [
            messages.EpisodeInfo(
                episode=f"e{request.skip + number}", code="KQXZB-MHTWA", task="x", clock="turn",
                phase="waiting", step=0, max_steps=9, seats=[],
            )
            for number in range(100)
        ]  # fmt: skip
        return messages.Episodes(episodes=rows, total=10**9)

    monkeypatch.setattr(client, "_ask", page)
    assert len(await client.episodes()) == 300
    assert sent == 3


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"sigth": 2}, "create has no option 'sigth'; did you mean 'sight'?"),
        ({"colour": "red"}, "create has no option 'colour'; docs/messages.md lists the options"),
        ({"seats": "many"}, "seats: Input should be a valid integer, found 'many'"),
    ],
)
async def test_wrong_option_of_an_episode_is_named_on_one_line(
    options: dict[str, Any], why: str
) -> None:
    async with listening(answering()) as url, connect(url, name="Ada", encoding="json") as client:
        with pytest.raises(WrongArgumentError) as error:
            await client.create("synchronous/01", **options)
        assert str(error.value) == why
