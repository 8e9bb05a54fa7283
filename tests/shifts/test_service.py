"""Shifts are played by bots, over a server, and in environments, and recorded."""

from __future__ import annotations

import asyncio
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robotouille import load_task
from robotouille.batch import BatchWorld
from robotouille.envs import RobotouilleEnv
from robotouille.errors import RobotouilleError
from robotouille.generation.generator import GenerationError, Generator
from robotouille.planning.policies.planner_policy import PlannerOptions
from robotouille.planning.policies.policy import Speech
from robotouille.planning.policies.shift_policy import ShiftPolicy
from robotouille.replay import Recording, read_recording
from robotouille.world.presentation.signals import Intent, Signal
from robotouille.world.world import State, World
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.bots.seat_policy import play
from tests.support.lost_connections import cut, miss_a_step
from tests.support.servers import crash, serving, with_clients
from tests.support.shifts import EXAMPLE, bistro, example, recomputed
from tests.support.virtual_time import virtual

ALONE = PlannerOptions(alone=True)
SANDWICHES = Path(__file__).parents[2] / "problems" / "shifts" / "01_sandwich_bar.json"


def scores(recording: Recording) -> list[int]:
    return [state.orders.score for _, state in recording.states() if state.orders is not None]


@pytest.mark.slow
@virtual
async def test_two_bots_serve_a_shift_over_a_server_with_a_crash(tmp_path: Path) -> None:
    folder = tmp_path / "tasks"
    folder.mkdir()
    shutil.copy(EXAMPLE, folder / "first_shift.json")
    recordings, options = tmp_path / "games", {"tasks": folder}
    make = policy_maker(BotKind.PLANNER)
    async with with_clients(recordings, "ada", "bob", **options) as (server, ada, bob):
        port = server.port
        created = await ada.create("first_shift@2", clock="lockstep", absence="pause", grace=300.0)
        games = [await client.join(created.code) for client in (ada, bob)]
        playing = [asyncio.create_task(play(game, make, threaded=False)) for game in games]
        while games[0].step < 40:
            await asyncio.sleep(0.05)
        cut(ada)
        while games[0].step < 70:
            await asyncio.sleep(0.05)
        await crash(server)
        async with serving(recordings, port=port, seed=2, **options):
            outcomes = await asyncio.gather(*playing)
            final = games[1].state
            await asyncio.sleep(1)
    recording = read_recording(next(recordings.glob("*.rbt")))
    assert recording.verify().ok
    assert outcomes[0]["reason"] == "shift_over"
    score = outcomes[0]["score"]
    assert score == outcomes[1]["score"] == recording.outcome["score"]
    assert (score["points"], score["served"], score["expired"]) == recomputed(recording)
    assert score["served"] >= 6
    assert score["expired"] == 0
    assert final.orders is not None
    assert final.orders.score == score["points"] == scores(recording)[-1]


@pytest.mark.slow
@virtual
async def test_who_comes_late_sees_the_orders(tmp_path: Path) -> None:
    folder = tmp_path / "tasks"
    folder.mkdir()
    shutil.copy(EXAMPLE, folder / "first_shift.json")
    async with with_clients(tmp_path / "games", "ada", "eve", tasks=folder) as (_, ada, eve):
        created = await ada.create("first_shift@1", clock="realtime", timing="benchmark")
        game = await ada.join(created.code)
        while game.state.orders.arrived < 3 and not game.ended:
            await asyncio.sleep(0.5)
        watched = await eve.join(created.code, role="spectator")
        miss_a_step(game)
        await asyncio.sleep(1.0)
        assert not game.ended
        assert watched.state.orders == game.state.orders
        assert watched.state.digest == game.state.digest


@pytest.mark.slow
def test_altered_score_of_a_recording_is_found(tmp_path: Path) -> None:
    recording = played_alone(tmp_path, 130)
    assert recording.verify().ok
    assert recording.outcome is not None
    recording.outcome["score"]["points"] += 1
    assert "the outcome has the score" in recording.verify().fault


def played_alone(folder: Path, seconds: int) -> Recording:
    """Record a shift in which nobody does anything."""

    @virtual
    async def main() -> None:
        tasks = folder / "tasks"
        tasks.mkdir()
        shutil.copy(EXAMPLE, tasks / "first_shift.json")
        async with with_clients(folder / "games", "ada", tasks=tasks) as (_, ada):
            created = await ada.create("first_shift", clock="realtime", timing="benchmark")
            game = await ada.join(created.code)
            await asyncio.sleep(seconds)
            assert game.ended
            assert game.outcome["score"]["points"] < 0

    main()
    return read_recording(next((folder / "games").glob("*.rbt")))


# Bots


def served_alone(world: World, steps: int) -> list[State]:
    """Return all states of a shift in which a bot is alone."""
    policy, state = ShiftPolicy(world, "robot1", ALONE), world.initial
    states = [state]
    for _ in range(steps):
        action = policy.act(state)
        result = state.step(action)
        assert all(attempt.applied for attempt in result.attempts)
        policy.observe([("robot1", a.action, a.applied) for a in result.attempts])
        state = result.state
        states.append(state)
    return states


@pytest.mark.slow
def test_bot_washes_plates_and_cooks_soup_for_its_orders(tmp_path: Path) -> None:
    arrivals = [{"at": 20 * i, "dish": dish} for i, dish in enumerate(["toast", "toast", "soup"])]
    state = served_alone(bistro(tmp_path, arrivals=arrivals), 130)[-1]
    assert state.orders is not None
    assert (state.orders.served, state.orders.expired) == (3, 0)


def test_bot_without_orders_waits_for_nobody(tmp_path: Path) -> None:
    shift = json.loads(SANDWICHES.read_text())
    shift["shift"]["arrivals"] = [{"at": 9, "dish": "cheese sandwich"}]
    path = tmp_path / "later.json"
    path.write_text(json.dumps(shift))
    world = World(f"{path}@2")
    bot = ShiftPolicy(world, "robot2", start=world.initial)
    bot.meet({"robot1": "human", "robot2": "bot"}, "realtime")
    bot.act(world.initial)
    assert not bot.waiting


def test_bot_does_nothing_without_orders(tmp_path: Path) -> None:
    world = bistro(tmp_path, arrivals=[{"at": 9, "dish": "toast"}])
    policy, state = ShiftPolicy(world, "robot1", ALONE), world.initial
    for _ in range(9):
        assert policy.act(state) is None
        state = state.step(None).state
    assert policy.act(state) is not None


@pytest.mark.slow
def test_bot_finishes_what_is_on_the_hatch_before_a_more_urgent_dish(tmp_path: Path) -> None:
    problem = json.loads(SANDWICHES.read_text())
    shift = problem["shift"]
    # The order for tomato arrives when bread and cheese are on the hatch.
    shift["arrivals"] = [
        {"at": 0, "dish": "cheese sandwich"},
        {"at": 8, "dish": "tomato sandwich"},
    ]
    shift["menu"]["tomato sandwich"]["patience"] = 30
    for scores in ("stars", "planner", "planner_people"):
        del shift[scores]
    (tmp_path / "sandwiches.json").write_text(json.dumps(problem))
    world = World(load_task(str(tmp_path / "sandwiches.json"), seats=1))
    states = served_alone(world, 30)
    served_first, both = states[12].orders, states[30].orders
    assert served_first is not None
    assert [order.number for order in served_first.open] == [1]
    assert both is not None
    assert (both.served, both.expired) == (2, 0)


def test_a_favour_lasts_when_the_next_order_begins(tmp_path: Path) -> None:
    arrivals = [{"at": 0, "dish": "toast"}, {"at": 1, "dish": "toast"}]
    world = bistro(tmp_path, arrivals=arrivals)
    policy, state = ShiftPolicy(world, "robot1", ALONE, start=world.initial), world.initial
    policy.meet({"robot1": "bot", "person": "human"}, "realtime")
    while state.orders is not None and not state.orders.served:
        action = policy.act(state)
        nearly = state.step(action).state
        if nearly.orders is not None and nearly.orders.served:
            policy.hear("person", Speech("", Signal(Intent.WAIT)))
            action = state.actions("robot1")[0] if action is None else action
        policy.observe([("robot1", action, True)] if action is not None else [])
        state = nearly
    assert policy.act(state) is None


# Environments


@pytest.mark.slow
def test_environment_rewards_points_and_ends_with_the_shift(tmp_path: Path) -> None:
    world = bistro(tmp_path, steps=90, arrivals=[{"at": 0, "dish": "toast"}])
    env = RobotouilleEnv(world.task, max_steps=500)
    observation, _ = env.reset(seed=1)
    columns = list(world.encoding.columns)
    assert observation[columns.index("steps_left")] == 90
    assert observation[columns.index("order1(toast)")] == 80
    assert observation[columns.index("order1(soup)")] == 0
    policy, rewards, ended = ShiftPolicy(world, "robot1", ALONE), [], False
    while not ended:
        state = env.unwrapped.state
        action = policy.act(state)
        chosen = (
            next(a for a in state.actions("robot1") if a.name == "wait")
            if action is None
            else action
        )
        _, reward, ended, truncated, _ = env.step(state.action_number(chosen))
        policy.observe([("robot1", chosen, True)])
        rewards.append(reward)
        assert not truncated
    assert len(rewards) == 90
    assert [reward for reward in rewards if reward] == [float(10 + 8 * 72 // 80)]
    assert np.isfinite(rewards).all()


def test_environment_of_a_shift_lasts_as_long_as_the_shift(tmp_path: Path) -> None:
    world = bistro(tmp_path, steps=310, arrivals=[{"at": 0, "dish": "toast"}])
    env = RobotouilleEnv(world.task)
    env.reset()
    wait = env.unwrapped.state.action_number(
        next(a for a in env.unwrapped.state.actions("robot1") if a.name == "wait")
    )
    ends = [env.step(wait)[2:4] for _ in range(310)]
    assert ends[:-1] == [(False, False)] * 309
    assert ends[-1] == (True, False)


def test_batch_engine_refuses_a_shift() -> None:
    with pytest.raises(RobotouilleError, match="does not support shifts"):
        BatchWorld(World(example()), 2)


def test_task_survives_json() -> None:
    task: Any = json.loads(json.dumps(example(seed=5).to_json()))
    assert task["problem"]["shift"]["arrivals"][0]["at"] == 0


def test_generator_and_shaped_rewards_refuse_a_shift() -> None:
    with pytest.raises(GenerationError, match="is a shift"):
        Generator(example())
    with pytest.raises(RobotouilleError, match="a shift rewards points"):
        RobotouilleEnv(example(seats=1), reward="shaped")
