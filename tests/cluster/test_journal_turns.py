"""Order in which a node reads and replays journals."""

from __future__ import annotations

import asyncio
import random
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from robotouille_client import Client, Game, connect
from robotouille_server.cluster.bus import Stored
from robotouille_server.cluster.episodes import claims, journal_turns
from robotouille_server.cluster.episodes.directory import EpisodeRecord
from robotouille_server.cluster.episodes.handing_over import Offer
from robotouille_server.cluster.episodes.journal import ReplicatedJournal
from robotouille_server.cluster.episodes.journal_turns import (
    AT_A_TIME,
    LONG_AT_A_TIME,
    JournalTurns,
)
from tests.support.buses import SimulatedNats
from tests.support.clusters import Node, Nodes, cluster_of, cluster_on
from tests.support.virtual_time import virtual


async def played(client: Client, steps: int = 5) -> Game:
    """Return a game of one player after some steps in which the player waits."""
    game = await client.join((await client.create("training/01", move_budget=0)).code)
    for _ in range(steps):
        await game.act(None)
    return game


def journal_of(nodes: Nodes, game: Game) -> ReplicatedJournal:
    journal = nodes.owner(game.episode).server.lobby.rooms[game.episode].journal
    assert isinstance(journal, ReplicatedJournal)
    return journal


def record_at(node: Node, game: Game) -> EpisodeRecord:
    record = node.cluster.node.directory.find(game.episode)
    assert record is not None
    return record


@virtual
async def test_short_recordings_do_not_wait_for_long_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nats = SimulatedNats(random.Random(1))
    async with cluster_on(nats, tmp_path / "old", 1) as old, AsyncExitStack() as stack:
        games = []
        for i in range(6):
            client = await stack.enter_async_context(connect(old[0].url, name=f"ada{i}"))
            games.append(await played(client, 0))
        # Without lengths, the first id comes first.
        games.sort(key=lambda game: game.episode)
        for i, game in enumerate(games):
            for _ in range(60 - 10 * i):
                await game.act(None)
        await asyncio.sleep(1)
        monkeypatch.setattr(claims, "SHORT_JOURNAL", journal_of(old, games[3]).size)
        async with cluster_on(nats, tmp_path / "new", 1, seed=1) as new:
            await asyncio.sleep(2)
            await old[0].kill()
            await asyncio.sleep(30)
            restored = [room.episode.step for room in new[0].server.lobby.rooms.values()]
            assert sorted(restored[:3]) == [10, 20, 30]
            assert sorted(restored[3:5]) == [40, 50], "two long ones at a time, the shortest first"
            assert restored[5:] == [60]


@virtual
async def test_a_long_game_stays_at_a_node_that_comes_back_before_its_turn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "SHORT_JOURNAL", 0)
    monkeypatch.setattr(journal_turns, "LONG_AT_A_TIME", 1)
    async with (
        cluster_of(tmp_path) as nodes,
        connect(nodes[0].url, name="ada") as ada,
        connect(nodes[0].url, name="bob") as bob,
    ):
        first, second = await played(ada, 1), await played(bob)
        other = nodes.others(nodes.owner(second.episode))[0]
        read, asked, go_on = other.bus.read, list[str](), asyncio.Event()

        async def slow(subject: str, after: int = 0) -> list[Stored]:
            asked.append(subject)
            if asked.count(first.episode) == 2:
                await go_on.wait()
            return await read(subject, after)

        monkeypatch.setattr(other.bus, "read", slow)
        node = other.cluster.node
        preparing = asyncio.create_task(node.claims.prepare(record_at(other, first)))
        await asyncio.sleep(1)
        claiming = asyncio.create_task(node.claims.claim(record_at(other, second)))
        await asyncio.sleep(1)
        async with asyncio.timeout(1):
            await second.act(None)
        go_on.set()
        await preparing
        assert await claiming == "its node has come back"
        await second.act(None)
        assert second.step == 7
        assert nodes.owner(second.episode) is not other


@virtual
async def test_a_long_game_can_be_taken_over_while_it_is_prepared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "SHORT_JOURNAL", 0)
    monkeypatch.setattr(journal_turns, "LONG_AT_A_TIME", 1)
    async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
        game = await played(ada)
        owner = nodes.owner(game.episode)
        other = nodes.others(owner)[0]
        record, journal = record_at(other, game), journal_of(nodes, game)
        journal.keep_tail()
        preparing = asyncio.create_task(other.cluster.node.claims.prepare(record))
        await game.act(None)
        owner.server.lobby.rooms[game.episode].suspend()
        offer = Offer(owner.cluster.node.name, journal.tail)
        assert await other.cluster.node.claims.claim(record, offer) == ""
        await preparing
        assert other.rooms == {game.episode}


@virtual
async def test_a_place_is_left_to_short_journals() -> None:
    turns, long_ones = JournalTurns(), 0

    async def replay(size: int) -> None:
        nonlocal long_ones
        async with turns.replaying_long(size):
            long_ones += 1
            await asyncio.sleep(60)

    tasks = [asyncio.create_task(replay(size)) for size in range(5)]
    await asyncio.sleep(1)
    async with asyncio.timeout(1), turns.reading():
        assert long_ones == LONG_AT_A_TIME < AT_A_TIME
    await asyncio.gather(*tasks)


@virtual
async def test_cancelled_turns_leave_their_places() -> None:
    turns, order = JournalTurns(), list[int]()

    async def replay(size: int) -> None:
        async with turns.replaying_long(size):
            order.append(size)
            await asyncio.sleep(60)

    tasks = [asyncio.create_task(replay(size)) for size in range(5)]
    await asyncio.sleep(1)
    for task in tasks[:-1]:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    assert order == [0, 1, 4]
