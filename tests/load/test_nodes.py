"""A bot of the load tester and a server of several nodes, in virtual time."""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import msgpack
import pytest
from websockets.asyncio.server import ServerConnection, serve
from websockets.typing import Subprotocol

from robotouille.protocol.codec import MSGPACK
from robotouille_client.loadtest.light_connection import UnreachableError
from robotouille_client.loadtest.participant import Environment, LostError, Participant
from tests.support.virtual_time import virtual

NOWHERE = "ws://127.0.0.1:9"
JOINED = {"type": "joined", "episode": "e1", "code": "KQXZB-MHTWA", "resume": "seat"}


class Node:
    """A node that answers each type of message with fixed messages."""

    def __init__(self, **answers: list[dict[str, Any]]) -> None:
        self.answers = answers
        self.url = ""
        self.received: list[dict[str, Any]] = []
        self.sockets: list[ServerConnection] = []

    async def handle(self, socket: ServerConnection) -> None:
        self.sockets.append(socket)
        async for payload in socket:
            message = msgpack.unpackb(payload)
            self.received.append(message)
            for answer in self.answers.get(message["type"], ()):
                await socket.send(msgpack.packb(answer))


class Bot(Participant):
    """A bot that returns whenever it is interrupted."""

    returned: asyncio.Task[dict[str, Any]] | None = None

    def interrupted(self) -> None:
        self.returned = asyncio.ensure_future(self.return_to_seat())


def welcome(*nodes: str) -> dict[str, Any]:
    return {"type": "welcome", "resume": "lobby", "nodes": list(nodes)}


def moved(url: str) -> dict[str, Any]:
    return {"type": "moved", "episode": "e1", "port": 1, "url": url}


@asynccontextmanager
async def running(node: Node) -> AsyncIterator[Node]:
    protocols = [Subprotocol(MSGPACK.name)]
    async with serve(node.handle, "127.0.0.1", 0, subprotocols=protocols) as server:
        node.url = f"ws://127.0.0.1:{next(iter(server.sockets)).getsockname()[1]}"
        yield node


async def playing(node: Node) -> Bot:
    bot = Bot(Environment(node.url, rng=random.Random(1)), "ada")
    await bot.introduce()
    await bot.enter("KQXZB-MHTWA")
    return bot


@virtual
async def test_bot_finds_the_living_one_of_the_named_nodes() -> None:
    async with running(Node(hello=[welcome()])) as node:
        for seed in range(5):
            environment = Environment(f"{NOWHERE},{node.url}", rng=random.Random(seed))
            bot = Participant(environment, "ada")
            assert (await bot.introduce())["type"] == "welcome"
            bot.close()
    with pytest.raises(UnreachableError):
        await Participant(Environment(f"{NOWHERE},{node.url}"), "ada").introduce()


@virtual
async def test_bot_of_a_lost_node_returns_at_another_one() -> None:
    async with running(Node(hello=[welcome(), JOINED])) as other:
        async with running(Node(hello=[welcome(other.url, NOWHERE)], join=[JOINED])) as node:
            bot = await playing(node)
        assert bot.returned is not None
        begun = asyncio.get_running_loop().time()
        assert (await bot.returned)["type"] == "joined"
        assert asyncio.get_running_loop().time() - begun < 1.0
        assert [message["resume"] for message in other.received] == ["seat"]
        bot.close()


@virtual
async def test_bot_follows_an_episode_that_moves() -> None:
    async with (
        running(Node(hello=[welcome(), JOINED])) as there,
        running(Node(hello=[welcome()], join=[JOINED])) as here,
    ):
        bot = await playing(here)
        await here.sockets[0].send(msgpack.packb(moved(there.url)))
        await here.sockets[0].wait_closed()
        assert bot.returned is not None
        await bot.returned
        assert [message["resume"] for message in there.received] == ["seat"]
        bot.close()


@virtual
async def test_bot_waits_while_no_node_has_its_episode() -> None:
    handover = {"type": "error", "code": "server/handover", "message": "soon"}
    async with running(Node(hello=[welcome()], join=[JOINED])) as node:
        bot = await playing(node)
        node.answers["hello"] = [handover]
        await node.sockets[0].close()
        await asyncio.sleep(5)
        assert bot.returned is not None
        assert not bot.returned.done()
        node.answers["hello"] = [welcome(), JOINED]
        assert (await bot.returned)["type"] == "joined"
        bot.close()


@virtual
async def test_redirects_in_a_circle_end() -> None:
    async with running(Node()) as node:
        node.answers["hello"] = [moved(node.url)]
        with pytest.raises(LostError, match="in vain"):
            await Participant(Environment(node.url), "ada").introduce()
        assert len(node.received) == 4
