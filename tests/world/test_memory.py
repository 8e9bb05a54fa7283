"""The caches of a world are limited, and clearing them changes nothing."""

from __future__ import annotations

import gc
import random

import pytest

from robotouille import World, load_task
from robotouille.world import timers
from robotouille.world.grounding import goal, successors
from tests.support.samples import quick_sample
from tests.world.differential import WALKS, walk_both

SMALL = 7
LIMIT = 50


def limit(patch: pytest.MonkeyPatch, most: int) -> None:
    patch.setattr(timers, "MAX_KEPT", most)
    patch.setattr(goal, "MAX_KEPT", most)
    patch.setattr(successors, "MAX_NODES", most)


@pytest.mark.parametrize(("name", "timing", "steps"), quick_sample(WALKS, 4))
def test_small_caches_do_not_change_results(
    name: str, timing: str, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    limit(monkeypatch, SMALL)
    assert walk_both(load_task(name, timing=timing), steps, seed=3) > steps // 8


def long_play(name: str, timing: str) -> World:
    """Return a world after ten random episodes."""
    world = World(load_task(name, timing=timing))
    for seed in range(10):
        choose = random.Random(seed)
        state = world.initial
        for _ in range(300):
            valid = [state.actions(player) for player in world.players]
            state = state.step([choose.choice(actions) for actions in valid if actions]).state
    return world


def timers_in_memory(world: World) -> list[timers.Timers]:
    gc.collect()
    return [t for t in gc.get_objects() if type(t) is timers.Timers and t.table is world.timers]


def transitions(world: World) -> int:
    return sum(len(t.ticked) + len(t.started) for t in timers_in_memory(world))


@pytest.mark.slow
def test_cached_timer_transitions_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    limit(monkeypatch, LIMIT)
    world = long_play("multi_agent/01@4", "people")
    assert transitions(world) <= LIMIT
    # Where each transition leads from and to, the one without any timer and the present one.
    assert len(timers_in_memory(world)) <= 2 * LIMIT + 2


def test_cached_goal_results_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    limit(monkeypatch, LIMIT)
    assert len(long_play("synchronous/01", "benchmark").goal._known) <= LIMIT
