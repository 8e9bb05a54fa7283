"""Whole episodes with bots."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from math import floor
from pathlib import Path
from typing import Any, Literal

import pytest

from robotouille import State, World, load_task, task_names
from robotouille.episode import Clock
from robotouille.installation import data_folder
from robotouille.planning.plan import Plan, read_plan
from robotouille.planning.policies.policy import Script
from robotouille.replay.recording import read_recording
from robotouille_client import Client, StateChanged, connect
from robotouille_client.bots import Policy, RandomPolicy, play
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.bots.seat_policy import MakePolicy
from robotouille_server import Server
from tests.support.samples import quick_sample, quick_sample_of_pairs
from tests.support.servers import serving
from tests.support.virtual_time import run

OPTIMAL = {
    "synchronous/": (8, 14, 24, 11, 15, 23, 36, 36, 60, 54),
    "asynchronous/": (17, 23, 33, 42, 46, 19, 42, 40, 58, 72),
}
"""Proven lengths of shortest plans, in the order of the tasks' names."""
LENGTHS = {
    name: length
    for folder, lengths in OPTIMAL.items()
    for name, length in zip(
        sorted(name for name in task_names() if name.startswith(folder)), lengths, strict=True
    )
}
planner = policy_maker(BotKind.PLANNER)


async def finish(
    folder: Path, name: str, clock: Clock, seats: int, make: MakePolicy, **options: Any
) -> Mapping[str, Any]:
    """Play one episode with a bot in each seat and return its outcome."""
    async with serving(folder, mode=clock, max_steps=1500, **options) as server:
        async with connect(server.url, name="host") as host:
            created = await host.create(name, seats=seats)

            async def bot(number: int) -> Mapping[str, Any]:
                encoding: Literal["msgpack", "json"] = "json" if number % 2 else "msgpack"
                async with connect(server.url, name=f"bot{number}", encoding=encoding) as client:
                    await asyncio.sleep(0.01 * number)
                    return await play(await client.join(created.code), make, threaded=False)

            outcomes = await asyncio.gather(*(bot(i) for i in range(seats)))
    assert all(outcome == outcomes[0] for outcome in outcomes)
    return outcomes[0]


@pytest.mark.parametrize(
    ("name", "clock"), quick_sample_of_pairs(LENGTHS, list(Clock), 3, nightly=True)
)
def test_planner_takes_a_shortest_plan(tmp_path: Path, name: str, clock: Clock) -> None:
    options = {"timing": "benchmark"} if clock is Clock.REALTIME else {}
    outcome = run(finish(tmp_path, name, clock, 1, planner, **options))
    assert outcome["reason"] == "goal", outcome
    assert outcome["steps"] <= floor(1.05 * LENGTHS[name])


@pytest.mark.parametrize(
    "name", quick_sample(["synchronous/03", "asynchronous/08", "asynchronous/10"])
)
def test_planner_with_peoples_timing(tmp_path: Path, name: str) -> None:
    outcome = run(finish(tmp_path, load_task(name).name, Clock.REALTIME, 1, planner))
    assert outcome["reason"] == "goal", outcome


DATASETS = ("synchronous/", "asynchronous/", "multi_agent/")
TASKS = [name for name in task_names() if name.startswith(DATASETS)]


def plan_file(name: str, seats: int) -> Path:
    """Return the shipped plan of a problem."""
    suffix = f"@{seats}" if name.startswith("multi_agent/") else ""
    return data_folder("problems") / f"{name}{suffix}.plan"


def scripted(world: World, plan: Plan) -> MakePolicy:
    def make(state: State, player: str) -> Policy:
        return Script(player, plan, world.initial)

    return make


def check_recordings(folder: Path, *, goal: bool = True) -> None:
    """Check that every recording in a folder verifies and can be reproduced byte for byte."""
    files = list(folder.glob("*.rbt"))
    assert files
    for file in files:
        recording = read_recording(file)
        assert recording.verify().ok
        assert recording.resimulate() == recording.stream
        if goal:
            *_, (_, last) = recording.states()
            assert last.goal_reached
        file.unlink()


def test_there_are_thirty_tasks() -> None:
    assert [sum(t.startswith(d) for t in TASKS) for d in DATASETS] == [10, 10, 10]


@pytest.mark.parametrize(
    ("name", "clock"), quick_sample_of_pairs(TASKS, list(Clock), 3, nightly=True)
)
def test_bots_finish_the_task(tmp_path: Path, name: str, clock: Clock) -> None:
    seats = load_task(name).seats
    world = World(load_task(name, seats=seats))
    plan = read_plan(plan_file(name, seats).read_text(), world)
    outcome = run(finish(tmp_path, name, clock, seats, scripted(world, plan)))
    assert outcome["reason"] == "goal", outcome
    if clock is not Clock.REALTIME and seats == 1:
        assert outcome["steps"] == len(plan)
    check_recordings(tmp_path)


STEPS = 24


async def follow(client: Client, code: str, seed: int) -> list[str]:
    """Play a seat at random; return the hash of every state."""
    game = await client.join(code)
    assert game.seat is not None
    policy = RandomPolicy(game.seat, seed)
    hashes: list[str] = []
    decided = -1
    while not game.ended:
        for event in game.poll():
            if isinstance(event, StateChanged):
                hashes.append(event.state.digest)
        if game.ended:
            break
        if game.my_move and decided < game.step:
            decided = game.step
            game.submit(policy.act(game.state))
        else:
            event = await game.next_event()
            if isinstance(event, StateChanged):
                hashes.append(event.state.digest)
    return hashes


async def one_episode(server: Server, task: str, clock: str, seed: int) -> list[list[str]]:
    async with connect(server.url, name="host") as host:
        created = await host.create(task, clock=clock, max_steps=STEPS)
    seats = 1 if task.startswith(("s", "a")) else 2

    async def seat(number: int) -> list[str]:
        async with connect(server.url, name=f"bot{number}") as client:
            await asyncio.sleep(0.01 * number)
            return await follow(client, created.code, seed + number)

    return list(await asyncio.gather(*(seat(i) for i in range(seats))))


@pytest.mark.parametrize("neighbours", [5, pytest.param(100, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("task", "clock"),
    quick_sample([("multi_agent/10@2", "lockstep"), ("asynchronous/06", "realtime")]),
)
def test_other_episodes_change_nothing(
    tmp_path: Path, task: str, clock: str, neighbours: int
) -> None:
    async def main(folder: Path, neighbours: int) -> list[list[str]]:
        async with serving(folder, messages_per_second=10_000) as server:
            others = [
                asyncio.create_task(
                    one_episode(
                        server, ("asynchronous/06", "synchronous/02")[i % 2], clock, 1000 + i
                    )
                )
                for i in range(neighbours)
            ]
            if others:
                await asyncio.sleep(0.05)
            course = await one_episode(server, task, clock, 7)
            for other in others:
                other.cancel()
            await asyncio.gather(*others, return_exceptions=True)
            return course

    alone = run(main(tmp_path / "alone", 0))
    crowded = run(main(tmp_path / "crowded", neighbours))
    assert [len(hashes) > STEPS // 2 for hashes in alone] == [True] * len(alone)
    assert [hashes[-STEPS:] for hashes in crowded] == [hashes[-STEPS:] for hashes in alone]
