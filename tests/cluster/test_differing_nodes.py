"""Nodes that differ in their tasks, clocks, keys or versions."""

from __future__ import annotations

import asyncio
import random
import shutil
from pathlib import Path
from typing import Any

import pytest
from structlog.testing import capture_logs

from robotouille.errors import ProtocolError
from robotouille.installation import data_folder
from robotouille.replay.recording import read_recording
from robotouille_client import Game, connect
from tests.support.buses import SimulatedNats
from tests.support.clusters import Nodes, cluster_of, cluster_on
from tests.support.virtual_time import virtual

TASK = "training/03_multi_agent"
HOUR = 3600.0


def nats() -> SimulatedNats:
    return SimulatedNats(random.Random(1))


def errors(logs: list[Any], event: str) -> set[str]:
    """Return the nodes that errors with an event name."""
    return {log["nodes"] for log in logs if event in log["event"]}


async def step(*games: Game) -> None:
    await asyncio.gather(*(game.act(None) for game in games))


@pytest.fixture
def lunch(tmp_path: Path) -> dict[str, Path]:
    """Option of a node that has a task of the operator, `lunch`."""
    folder = tmp_path / "tasks"
    folder.mkdir()
    shutil.copy(data_folder("problems") / f"{TASK}.json", folder / "lunch.json")
    return {"tasks": folder}


class TestTasks:
    @virtual
    async def test_new_episodes_open_where_the_task_is(
        self, tmp_path: Path, lunch: dict[str, Path]
    ) -> None:
        each = [lunch, {}, lunch]
        with capture_logs() as logs:
            async with (
                cluster_on(nats(), tmp_path, 3, each=each) as nodes,
                connect(nodes[0].url, name="ada") as ada,
                connect(nodes[1].url, name="bob") as bob,
            ):
                await asyncio.sleep(2)
                for _ in range(4):
                    await ada.create("lunch")
                assert [len(node.rooms) for node in nodes] == [2, 0, 2]
                with pytest.raises(ProtocolError) as error:
                    await bob.create("lunch")
                assert error.value.code == "task/unknown"
                both = f"{nodes[0].url}, {nodes[2].url}", f"{nodes[2].url}, {nodes[0].url}"
                named = errors(logs, "have other tasks")
                assert nodes[1].url in named
                assert named & set(both)

    @virtual
    async def test_episodes_continue_on_nodes_without_the_task(
        self, tmp_path: Path, lunch: dict[str, Path]
    ) -> None:
        async with cluster_on(nats(), tmp_path, 2, each=[lunch, {}], max_steps=3) as nodes:
            await asyncio.sleep(2)
            async with (
                connect(nodes[0].url, name="ada") as ada,
                connect(nodes[1].url, name="bob") as bob,
            ):
                created = await ada.create("lunch", seats=2, move_budget=0)
                games = await ada.join(created.code), await bob.join(created.code)
                await step(*games)
                await nodes[0].kill()
                await step(*games)
                assert nodes.owner(created.episode) is nodes[1]
                await step(*games)
            await ended(tmp_path, steps=3)


async def ended(folder: Path, steps: int) -> None:
    """Wait until the only recording is closed, and verify it."""
    await asyncio.sleep(2)
    (path,) = folder.glob("node*/*.rbt")
    found = read_recording(path).verify()
    assert (found.ok, found.complete, found.steps) == (True, True, steps)


@virtual
async def test_a_game_goes_from_node_to_node_although_their_clocks_differ(tmp_path: Path) -> None:
    clocks = [0.0, HOUR, -HOUR]
    async with cluster_on(nats(), tmp_path, 3, clocks=clocks, max_steps=6) as nodes:
        async with (
            connect(nodes[0].url, name="ada") as ada,
            connect(nodes[1].url, name="bob") as bob,
        ):
            created = await ada.create(TASK, seats=2, move_budget=0)
            games = await ada.join(created.code), await bob.join(created.code)
            await step(*games)
            first = nodes.owner(created.episode)
            await first.kill()
            await step(*games)
            second = nodes.owner(created.episode)
            assert second is not first
            await second.leave()
            await step(*games)
            for _ in range(3):
                await step(*games)
            assert games[0].ended
        await ended(tmp_path, steps=6)


@virtual
async def test_two_clusters_with_one_name_and_other_keys_are_named(tmp_path: Path) -> None:
    each = [{"signing_keys": f"{name}:{name * 43}"} for name in "AE"]
    with capture_logs() as logs:
        async with (
            cluster_on(nats(), tmp_path, 2, each=each) as nodes,
            connect(nodes[0].url, name="ada") as ada,
        ):
            await asyncio.sleep(2)
            assert errors(logs, "other keys") == {node.url for node in nodes}
            assert (await ada.create(TASK)).episode


class TestVersions:
    @virtual
    async def test_nodes_of_another_version_are_named_and_get_no_episodes(
        self, tmp_path: Path
    ) -> None:
        with capture_logs() as logs:
            async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
                change(nodes, 2, release="robotouille 9.9")
                await asyncio.sleep(2)
                for _ in range(4):
                    await ada.create(TASK)
                assert [len(node.rooms) for node in nodes] == [2, 2, 0]
                assert nodes[2].url in errors(logs, "run another version")

    @virtual
    async def test_nodes_of_another_protocol_are_named_and_get_no_episodes(
        self, tmp_path: Path
    ) -> None:
        with capture_logs() as logs:
            async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
                change(nodes, 1, protocol=99)
                await asyncio.sleep(2)
                for _ in range(4):
                    await ada.create(TASK)
                assert [len(node.rooms) for node in nodes] == [2, 0, 2]
                assert nodes[1].url in errors(logs, "another version of the protocol")
                await nodes[0].leave()
                assert [len(node.rooms) for node in nodes] == [0, 0, 4]


@virtual
async def test_forged_reports_put_few_printable_names_into_the_log(tmp_path: Path) -> None:
    """Whoever may write to NATS may report nodes of any number and name."""
    async with cluster_of(tmp_path) as nodes:
        for i in (1, 2):
            change(nodes, i, release="9.9", url=f"ws://evil:{i}/\x1b[31m\n" + "x" * 5000)
        with capture_logs() as logs:
            await asyncio.sleep(2)
    lines = errors(logs, "run another version")
    assert any("evil:1" in line for line in lines)
    assert all(line.isprintable() and len(line) < 1000 for line in lines)


def change(nodes: Nodes, i: int, **changes: Any) -> None:
    """Change what a node reports of itself."""
    members = nodes[i].cluster.node.members
    members.own = members.own.model_copy(update=changes)
