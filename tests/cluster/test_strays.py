"""Journals of episodes that no record names."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille_client import connect
from robotouille_server.cluster.bus import Bucket
from robotouille_server.cluster.episodes import strays
from robotouille_server.cluster.episodes.directory import EpisodeRecord
from robotouille_server.cluster.members import LEASE_SECONDS, RENEW_SECONDS
from robotouille_server.runtime.work_in_turns import FRAMES_A_TURN
from tests.support.clusters import Node, cluster_of
from tests.support.frames_in_turns import count_frames
from tests.support.virtual_time import virtual

TASK = "training/03_multi_agent"
LONG_ENOUGH = 15.0


@pytest.fixture(autouse=True)
def frequent_sweeps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(strays, "SWEEP_SECONDS", 4.0)


async def open_without_registering(node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kill a node between the first write of a journal and the registration of its episode."""
    registering = asyncio.Event()

    async def die(record: EpisodeRecord) -> None:
        registering.set()
        await asyncio.Event().wait()

    monkeypatch.setattr(node.cluster.node.directory, "add", die)
    async with connect(node.url, name="ada") as ada:
        opening = asyncio.create_task(ada.create(TASK))
        await registering.wait()
        opening.cancel()
        await node.kill()


@virtual
async def test_a_journal_that_was_never_registered_is_deleted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with cluster_of(tmp_path, 3) as nodes:
        await open_without_registering(nodes[0], monkeypatch)
        (stray,) = nodes.nats.storage.journals
        await asyncio.sleep(LEASE_SECONDS + 2 * RENEW_SECONDS)
        async with connect(nodes[1].url, name="bob") as bob:
            running = await bob.create(TASK)
            await asyncio.sleep(LONG_ENOUGH)
            assert nodes.nats.storage.journals == [running.episode] != [stray]


@virtual
async def test_a_journal_of_players_outlives_its_record(tmp_path: Path) -> None:
    async with cluster_of(tmp_path, 3) as nodes, connect(nodes[0].url, name="ada") as ada:
        created = await ada.create(TASK)
        await ada.join(created.code)
        await nodes.owner(created.episode).kill()
        nodes.nats.storage.set(Bucket.EPISODES, created.code.replace("-", ""), None)
        await asyncio.sleep(LONG_ENOUGH)
        assert nodes.nats.storage.journals == [created.episode]


@virtual
async def test_a_node_whose_copy_of_the_directory_is_behind_deletes_nothing(tmp_path: Path) -> None:
    async with cluster_of(tmp_path, 3) as nodes:
        sweeper = min(nodes, key=lambda node: str(node.cluster.node.name))
        sweeper.bus.deafen()
        other = nodes.others(sweeper)[0]
        async with connect(other.url, name="ada") as ada:
            created = await ada.create(TASK)
            await asyncio.sleep(LONG_ENOUGH)
            assert nodes.nats.storage.journals == [created.episode]


@virtual
async def test_other_games_go_on_while_a_long_stray_journal_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with cluster_of(tmp_path, 3) as nodes, connect(nodes[0].url, name="ada") as ada:
        created = await ada.create("training/01", move_budget=0)
        game = await ada.join(created.code)
        for _ in range(40):
            await game.act(None)
        await nodes.owner(game.episode).kill()
        nodes.nats.storage.set(Bucket.EPISODES, created.code.replace("-", ""), None)
        frames = count_frames(monkeypatch)
        await asyncio.sleep(LONG_ENOUGH)
        assert sum(frames) > 40
        assert max(frames) <= FRAMES_A_TURN
