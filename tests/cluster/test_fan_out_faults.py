"""Spectators on all nodes while nodes and their connections to NATS fail."""

from __future__ import annotations

import asyncio
import random
import signal
from contextlib import AsyncExitStack, suppress
from pathlib import Path

import pytest

from robotouille_client import Game, connect
from robotouille_client.sansio.game_events import ChatReceived, StateChanged
from tests.programs.cluster_drill.cluster import Node as ProcessNode
from tests.programs.cluster_drill.cluster import running_cluster
from tests.support.buses import Quality
from tests.support.clusters import Nodes, cluster_of
from tests.support.nats import missing
from tests.support.samples import quick_sample
from tests.support.virtual_time import virtual

TASK = "training/03_multi_agent"
NODES, SPECTATORS, SECONDS = 4, 6, 30.0
PATIENCE = 60.0
LOST = frozenset(
    {
        "the node's report was not stored",
        "recording failed",
        "connection to NATS lost",
        "this node is cut off from NATS, and other nodes take its episodes over",
    }
)
"""Errors that a node logs while it is suspended or its neighbour is dead."""


class Seen:
    """Steps and messages of a game that one client has received.

    Attributes:
        digests: The digest of each state, by step.
        lines: The chat.
    """

    def __init__(self, game: Game) -> None:
        self.game = game
        self.digests: dict[int, str] = {}
        self.lines: list[str] = []
        self.steps: list[int] = []

    async def follow(self) -> None:
        while not self.game.ended:
            event = await self.game.next_event()
            if isinstance(event, StateChanged):
                self.digests[self.game.step] = self.game.state.digest
                self.steps.append(self.game.step)
            elif isinstance(event, ChatReceived):
                self.lines.append(event.text)


async def act(game: Game, chance: random.Random) -> None:
    """Do something in each step."""
    while not game.ended:
        with suppress(TimeoutError):
            async with asyncio.timeout(5):
                actions = game.actions if game.has_state else ()
                await game.act(chance.choice(actions) if actions else None)


async def trouble(nodes: Nodes, chance: random.Random) -> None:
    """Cut nodes off, lose messages, and kill one node."""
    loop = asyncio.get_running_loop()
    until, killed = loop.time() + SECONDS, False
    while loop.time() < until:
        await asyncio.sleep(chance.uniform(0.5, 4))
        node = chance.choice([node for node in nodes if not node.killed])
        fault = chance.choice(("cut", "deafen", "spoil", "spoil", "kill"))
        if fault == "cut":
            node.bus.cut(answers_only=chance.random() < 0.5)
            loop.call_later(chance.choice((0.3, 1.5, 5.0)), node.bus.heal)
        elif fault == "deafen":
            node.bus.deafen()
            loop.call_later(chance.choice((0.3, 1.5, 5.0)), node.bus.heal)
        elif fault == "spoil":
            nodes.nats.quality = Quality(0.005, 0.05, chance.choice((0.05, 0.3)), 0.1, 0.1, 1.0)
        elif not killed:
            killed = True
            await node.kill()
        await asyncio.sleep(chance.uniform(0.5, 4))
        nodes.nats.quality = Quality()
    for node in nodes:
        if not node.killed:
            node.bus.heal()


@pytest.mark.slow
@virtual
@pytest.mark.parametrize("seed", quick_sample(range(20), 1, nightly=4))
async def test_spectators_see_the_same_game_whatever_fails(tmp_path: Path, seed: int) -> None:
    chance = random.Random(seed)
    async with (
        cluster_of(tmp_path, NODES, max_steps=10_000) as nodes,
        AsyncExitStack() as stack,
        asyncio.TaskGroup() as work,
    ):
        # The order decides which node a client prefers. When it is lost, it goes to the others.
        urls = [",".join(node.url for node in nodes.nodes[i:] + nodes.nodes[:i]) for i in range(4)]
        clients = [
            await stack.enter_async_context(connect(urls[i % NODES], name=f"client {i}"))
            for i in range(2 + SPECTATORS)
        ]
        created = await clients[0].create(TASK, seats=2, clock="realtime", step_rate=5)
        games = [await client.join(created.code) for client in clients[:2]]
        for client in clients[2:]:
            games.append(await client.join(created.code, role="spectator"))
        seen = [Seen(game) for game in games]
        tasks = [work.create_task(one.follow()) for one in seen]
        tasks += [work.create_task(act(game, chance)) for game in games[:2]]
        await trouble(nodes, chance)
        await asyncio.sleep(15)
        games[0].say("the end")
        await asyncio.sleep(5)
        reached = games[0].step
        await asyncio.sleep(5)
        for task in tasks:
            task.cancel()
        assert reached > 20
        for one in seen:
            assert not one.game.ended, one.game.farewell
            assert one.game.step >= reached
            assert one.lines == ["the end"], one.game.name
            assert one.steps == sorted(one.steps)
            for step, digest in one.digests.items():
                assert seen[0].digests.get(step, digest) == digest


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.skipif(bool(missing()), reason=missing())
async def test_spectators_follow_a_game_over_three_processes_and_nats_servers(
    tmp_path: Path,
) -> None:
    """The owner is suspended and continues; the next owner is killed and starts again."""
    async with running_cluster(tmp_path, 3) as cluster, AsyncExitStack() as stack:
        nodes = cluster.nodes
        for node in nodes:
            node.process.allowed = LOST
        urls = [",".join(node.url for node in nodes[i:] + nodes[:i]) for i in range(3)]
        clients = [
            await stack.enter_async_context(connect(urls[i % 3], name=f"client {i}"))
            for i in range(6)
        ]
        options = {"clock": "realtime", "step_rate": 10, "max_steps": 400}
        created = await clients[0].create(TASK, seats=2, **options)
        games = [await client.join(created.code) for client in clients[:2]]
        places = [client.url for client in clients[2:]]
        for client in clients[2:]:
            games.append(await client.join(created.code, role="spectator"))
        seen = [Seen(game) for game in games]
        following = [asyncio.create_task(one.follow()) for one in seen]
        await reached(games, 20)
        assert [client.url for client in clients[2:]] == places

        def owner() -> ProcessNode:
            return next(node for node in nodes if node.url == clients[0].url)

        first = owner()
        first.process.send(signal.SIGSTOP)
        await asyncio.sleep(8)
        step = max(game.step for game in games)
        watching = [games[i] for i in range(2, 6) if clients[i].url != first.url]
        await reached(watching, step + 10)
        first.process.send(signal.SIGCONT)
        await asyncio.sleep(3)
        second = owner()
        assert second is not first
        step = max(game.step for game in games)
        await second.process.kill()
        await reached(games, step + 10)
        await second.start()
        async with asyncio.timeout(PATIENCE):
            await asyncio.gather(*following)
        assert {game.state.digest for game in games} == {games[0].state.digest}
        assert {game.step for game in games} == {400}
        for one in seen:
            assert one.steps == sorted(one.steps)
            for step, digest in one.digests.items():
                assert seen[0].digests.get(step, digest) == digest
        assert not cluster.faults


async def reached(games: list[Game], step: int) -> None:
    async with asyncio.timeout(PATIENCE):
        while min(game.step for game in games) < step:
            await asyncio.sleep(0.05)
