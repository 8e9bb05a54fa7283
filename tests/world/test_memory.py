"""What a world remembers of its transitions is bounded, and forgetting changes nothing."""

from __future__ import annotations

import gc
import random

import pytest

from robotouille import World, load_task
from robotouille.domain.task import build_task
from robotouille.world import timers
from robotouille.world.grounding import goal, successors
from robotouille.world.grounding.successors import DecisionNode, SuccessorTree
from tests.support.samples import first_quickly
from tests.world.differential import WALKS, walk_both

SMALL = 7
LIMIT = 50
UNLIMITED = 10**6


def limit(patch: pytest.MonkeyPatch, most: int) -> None:
    patch.setattr(timers, "MAX_KEPT", most)
    patch.setattr(goal, "MAX_KEPT", most)
    patch.setattr(successors, "MAX_NODES", most)


@pytest.mark.parametrize(("name", "timing", "steps"), first_quickly(WALKS, 4))
def test_a_forgetful_world_is_the_same_world(
    name: str, timing: str, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    limit(monkeypatch, SMALL)
    assert walk_both(load_task(name, timing=timing), steps, seed=3) > steps // 8


def long_play(name: str, timing: str) -> World:
    """A world in which there has been random play, ten times from the beginning."""
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


def nodes(tree: SuccessorTree) -> int:
    def below(node: DecisionNode) -> int:
        return 1 + sum(map(below, node.children.values()))

    return sum(below(node) for bucket in tree._buckets.values() for node in bucket)


@pytest.mark.slow
def test_transitions_of_timers_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    limit(monkeypatch, LIMIT)
    world = long_play("multi_agent/01@4", "people")
    assert transitions(world) <= LIMIT
    # Where each transition leads from and to, the one without any timer and the present one.
    assert len(timers_in_memory(world)) <= 2 * LIMIT + 2


@pytest.mark.slow
@pytest.mark.nightly
def test_nodes_of_trees_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    limit(monkeypatch, LIMIT)
    world = long_play("multi_agent/01@4", "benchmark")
    assert world._trees
    assert all(nodes(tree) <= LIMIT for tree in world._trees.values())


def test_what_is_known_of_the_goal_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    limit(monkeypatch, LIMIT)
    assert len(long_play("synchronous/01", "benchmark").goal._known) <= LIMIT


@pytest.mark.slow
def test_without_bounds_the_same_play_takes_more(monkeypatch: pytest.MonkeyPatch) -> None:
    limit(monkeypatch, UNLIMITED)
    assert transitions(long_play("multi_agent/01@4", "people")) > 3 * LIMIT
    world = long_play("multi_agent/01@4", "benchmark")
    assert min(nodes(tree) for tree in world._trees.values()) > 3 * LIMIT
    assert len(long_play("synchronous/01", "benchmark").goal._known) > LIMIT


def test_a_world_makes_room_for_one_more_of_each_kind() -> None:
    world = World("asynchronous/06")
    state = world.initial
    before = (state.digest, state.text(), state.actions("robot1"))
    sizes = world.table_sizes
    world.make_room_for_another()
    assert world.table_sizes[:-1] == sizes
    assert {"water1", "water2"} <= world.thing_names
    assert (state.digest, state.text(), state.actions("robot1")) == before


def test_where_nothing_can_be_created_there_is_no_room_to_make() -> None:
    task = load_task("synchronous/01")
    timeless = tuple(action for action in task.domain.action_defs if not action.sfx)
    domain = task.domain.model_copy(update={"action_defs": timeless})
    world = World(build_task("timeless", domain, task.problem))
    sizes, names = world.table_sizes, world.thing_names
    world.make_room_for_another()
    world.make_room({"water": 3})
    world.admit(["water1", "cheese9"])
    assert (world.table_sizes, world.thing_names) == (sizes, names)
