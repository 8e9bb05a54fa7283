"""What a world remembers of its transitions is bounded, and forgetting changes nothing."""

from __future__ import annotations

import gc
import random
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from robotouille import State, World, load_task
from robotouille.world import goal, successors, timers
from tests.world.differential import walk_both
from tests.world.test_world_equals_reference import WALKS

SMALL = 7


@pytest.fixture
def forgetful(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timers, "MAX_KEPT", SMALL)
    monkeypatch.setattr(goal, "MAX_KEPT", SMALL)
    monkeypatch.setattr(successors, "MAX_NODES", SMALL)


@pytest.mark.usefixtures("forgetful")
@pytest.mark.parametrize(("name", "timing", "steps"), WALKS)
def test_a_forgetful_world_is_the_same_world(name: str, timing: str, steps: int) -> None:
    assert walk_both(load_task(name, timing=timing), steps, seed=3) > steps // 8


def play(world: World, steps: int, seed: int) -> State:
    """Where random play ends."""
    choose = random.Random(seed)
    state = world.initial
    for _ in range(steps):
        valid = [state.actions(player) for player in world.players]
        state = state.step([choose.choice(actions) for actions in valid if actions]).state
    return state


def timers_in_memory(world: World) -> list[timers.Timers]:
    gc.collect()
    return [t for t in gc.get_objects() if isinstance(t, timers.Timers) and t.table is world.timers]


def test_long_play_in_one_world_takes_no_more_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timers, "MAX_KEPT", 50)
    world = World(load_task("multi_agent/01@4", timing="people"))
    for seed in range(10):
        play(world, 300, seed)
        known = timers_in_memory(world)
        assert sum(len(t.ticked) + len(t.started) for t in known) <= 50
        assert len(known) <= 2 * 50 + 2


def test_the_same_play_would_fill_it_several_times(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timers, "MAX_KEPT", 10**6)
    world = World(load_task("multi_agent/01@4", timing="people"))
    for seed in range(10):
        play(world, 300, seed)
    assert sum(len(t.ticked) + len(t.started) for t in timers_in_memory(world)) > 3 * 50


@pytest.mark.usefixtures("forgetful")
def test_threads_play_in_one_world(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bots that stand in think in threads, in the world in which the game goes on."""
    task = load_task("multi_agent/01@4", timing="people")
    seeds = range(4)
    alone = [play(World(task), 200, seed).digest for seed in seeds]
    world = World(task)
    interval = sys.getswitchinterval()
    monkeypatch.setattr(timers, "MAX_KEPT", 30)
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor() as threads:
            together = list(threads.map(lambda seed: play(world, 200, seed).digest, seeds))
    finally:
        sys.setswitchinterval(interval)
    assert together == alone
