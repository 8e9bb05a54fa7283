"""The asyncio shell: sockets, futures and timers of a client."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest
from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as listen
from websockets.typing import Subprotocol

from robotouille import ProtocolError
from robotouille.protocol.codec import JSON
from robotouille_client import Client, ConnectionFailedError, NotYetError, connect
from robotouille_client.sansio.client_state import ClientState
from tests.support.scripted_server import ScriptedServer
from tests.support.virtual_time import run

Converse = Callable[[ServerConnection], Awaitable[None]]
WELCOME = JSON.encode(ScriptedServer().welcome())


@asynccontextmanager
async def listening(converse: Converse) -> AsyncIterator[str]:
    """A server that does whatever a test wants; its URL."""
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


def test_a_server_that_says_nothing_is_given_up() -> None:
    async def main() -> None:
        async with listening(silent) as url:
            begun = asyncio.get_running_loop().time()
            with pytest.raises(ConnectionFailedError, match="did not welcome us"):
                async with connect(url, name="ada", encoding="json"):
                    raise AssertionError("not reached")
            assert 15 <= asyncio.get_running_loop().time() - begun < 20

    run(main())


def test_a_request_without_an_answer_is_given_up() -> None:
    async def main() -> None:
        async with listening(answering()) as url, connect(url, name="a", encoding="json") as ada:
            with pytest.raises(ConnectionFailedError, match="does not answer"):
                await ada.episodes()
            assert ada.connected.is_set()

    run(main())


def test_another_answer_than_expected_is_an_error() -> None:
    async def main() -> None:
        left = {"type": "left", "episode": "x"}
        async with (
            listening(answering(list=left)) as url,
            connect(url, name="ada", encoding="json") as ada,
        ):
            with pytest.raises(ProtocolError, match="Left in answer to list"):
                await ada.episodes()

    run(main())


def test_a_request_that_is_cancelled_is_forgotten() -> None:
    async def main() -> None:
        async with listening(answering()) as url, connect(url, name="a", encoding="json") as ada:
            asking = asyncio.create_task(ada.episodes())
            await asyncio.sleep(1)
            asking.cancel()
            await asyncio.wait({asking})
            assert asking.cancelled()
            assert ada.protocol.get_timer() is None

    run(main())


def test_nonsense_ends_the_connection_and_says_why() -> None:
    async def converse(socket: ServerConnection) -> None:
        await socket.recv()
        await socket.send(WELCOME)
        await socket.send('{"type": "nonsense"}')
        await socket.wait_closed()

    async def main() -> None:
        async with listening(converse) as url, connect(url, name="ada", encoding="json") as ada:
            while not ada.farewell:
                await asyncio.sleep(0.1)
            assert ada.farewell.startswith("the server's messages cannot be read: ")
            assert not ada.connected.is_set()
            with pytest.raises(ConnectionFailedError, match="cannot be read"):
                await ada.episodes()

    run(main())


@pytest.mark.parametrize(
    "answer",
    [b"\x95\x00", "nonsense", '{"type": "nonsense"}', '{"type": "welcome", "protocol": 99}'],
)
def test_what_answers_but_is_no_server_of_this_version_is_told_by_its_url(
    answer: str | bytes,
) -> None:
    async def converse(socket: ServerConnection) -> None:
        await socket.recv()
        await socket.send(answer)
        await socket.wait_closed()

    async def main() -> None:
        async with listening(converse) as url:
            said = f"{url} is of another version, or"
            with pytest.raises(ConnectionFailedError, match=said) as odd:
                async with connect(url, name="ada", encoding="json"):
                    raise AssertionError("nobody is there")
            assert "message/" not in str(odd.value)

    run(main())


def test_a_line_that_breaks_at_once_is_no_failure_to_connect() -> None:
    async def converse(socket: ServerConnection) -> None:
        await socket.recv()
        await socket.send(WELCOME)
        socket.transport.abort()

    async def main() -> None:
        async with listening(converse) as url, connect(url, name="ada", encoding="json") as ada:
            assert ada.farewell == ""
            assert ada.resume == "resume-1"

    run(main())


def test_who_is_asked_to_come_again_is_told_so() -> None:
    async def converse(socket: ServerConnection) -> None:
        await socket.recv()
        await socket.send('{"type": "bye", "reason": "full", "retry": true}')

    async def main() -> None:
        async with listening(converse) as url:
            with pytest.raises(NotYetError, match="full"):
                async with connect(url, name="ada", encoding="json"):
                    raise AssertionError("not reached")

    run(main())


def test_a_client_that_is_closed_leaves_no_task_behind() -> None:
    async def main() -> None:
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

    run(main())


def test_connecting_can_be_cancelled() -> None:
    async def main() -> None:
        async with listening(silent) as url:
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(1), connect(url, name="ada", encoding="json"):
                    raise AssertionError("not reached")
            assert {t for t in tasks() if "robotouille" in t.get_name()} == set()

    run(main())


@pytest.mark.parametrize(("phases", "found"), [(["over", "waiting", "waiting"], "K1"), ([], None)])
def test_the_first_episode_that_waits_is_found(phases: list[str], found: str | None) -> None:
    row = {"task": "t", "clock": "turn", "step": 0, "max_steps": 9, "seats": []}
    rows = [
        {"episode": f"e{number}", "code": f"K{number}", "phase": phase, **row}
        for number, phase in enumerate(phases)
    ]
    listed = {"type": "episodes", "episodes": rows, "total": len(rows)}

    async def main() -> None:
        async with (
            listening(answering(list=listed)) as url,
            connect(url, name="ada", encoding="json") as client,
        ):
            waiting = await client.waiting_episode()
            assert (waiting and waiting.code) == found

    run(main())
