"""States as vectors and actions as numbers, without loss or ambiguity."""

from __future__ import annotations

import copy
import pickle
import random
import subprocess
import sys

import numpy as np
import pytest

from robotouille import (
    RobotouilleError,
    SlotOverflowError,
    State,
    UnknownNameError,
    World,
    WrongArgumentError,
    load_task,
    task_names,
)
from robotouille.errors import TooHardError
from robotouille.world.arrays import reachable
from robotouille.world.arrays.encoding import Encoding
from tests.support.samples import quick_sample_per_folder


def played(world: World, seed: int, steps: int) -> list[State]:
    """Return the states of a random episode."""
    rng = random.Random(seed)
    states = [world.initial]
    for _ in range(steps):
        valid = [states[-1].actions(player) for player in world.players]
        states.append(states[-1].step([rng.choice(each) if each else None for each in valid]).state)
    return states


@pytest.mark.parametrize("name", quick_sample_per_folder(task_names()))
def test_masks_and_vectors_contain_the_whole_state(name: str) -> None:
    world = World(load_task(name))
    encoding = world.encoding
    vectors: dict[bytes, State] = {}
    bits = [world.table.bit[predicate, *args] for predicate, *args in encoding.atoms]
    columns = tuple(f"{predicate}({', '.join(args)})" for predicate, *args in encoding.atoms)
    assert encoding.columns[: len(columns)] == columns
    for state in played(world, 1, 120):
        for player in world.players:
            numbers = np.flatnonzero(state.mask(player))
            chosen = [encoding.action(state.facts, player, int(n)) for n in numbers]
            assert chosen == list(state.actions(player))
        vector = state.vector()
        assert vector.shape == (encoding.size,) == (len(encoding.columns),)
        assert vectors.setdefault(vector.tobytes(), state) == state
        true = vector[: len(columns)].astype(bool).tolist()
        assert true == [state.facts & bit != 0 for bit in bits]


@pytest.mark.parametrize("name", ["synchronous/02", "asynchronous/07", "multi_agent/07"])
def test_graph_equals_its_vector(name: str) -> None:
    world = World(load_task(name))
    encoding = world.encoding
    graphs: dict[bytes, State] = {}
    for state in played(world, 2, 150):
        nodes, edges, counters = graph = state.graph()
        assert nodes.shape == (len(encoding.objects), len(encoding.features))
        assert counters.shape == (len(edges), encoding.counters)
        names = [thing.name for thing in encoding.objects]
        there = {thing.name for thing in state.objects}
        shown = {names[i] for i in np.flatnonzero(nodes[:, encoding.features.index("exists")])}
        assert len(shown) == len(there) and shown - there <= encoding.slots.names
        if shown == there:
            said = {
                (feature, names[node])
                for node, column in np.argwhere(nodes)
                if (feature := encoding.features[column]) in world.table.types
            }
            said |= {(encoding.relations[r], names[a], names[b]) for r, a, b in edges}
            facts = {said_by for said_by in said if said_by[0] in world.table.types}
            assert facts == set(state.atoms())
        assert graphs.setdefault(b"".join(a.tobytes() for a in graph), state) == state


@pytest.mark.parametrize("name", ["synchronous/01", "asynchronous/07", "multi_agent/07"])
def test_action_and_number_are_inverse(name: str) -> None:
    world = World(load_task(name))
    for state in played(world, 3, 100)[::9]:
        for player in world.players:
            for action in state.actions(player):
                number = state.action_number(action, player)
                assert state.action(player, number) is action
                assert world.ground_actions(player)[number].name == action.name


def test_actions_about_empty_slots_are_none() -> None:
    world = World("asynchronous/07")
    slots = world.encoding.slots.by_kind["water"]
    actions = world.ground_actions("robot1")
    about = {slot: [n for n, a in enumerate(actions) if slot in a.arguments] for slot in slots}
    for there in (0, 2):
        state = many_waters(world, there)
        for place, slot in enumerate(slots):
            found = [state.action("robot1", number) for number in about[slot]]
            assert found and all((action is not None) == (place < there) for action in found)
    world.make_room({"water": 9})
    bit = world.table.bit["~exists", "water9"]
    state = State(world, world.initial.facts | bit, world.initial.timers)
    moved = {state.action("robot1", number) for number in about[slots[0]]}
    assert all(action is not None and "water9" in action.arguments for action in moved)
    assert {state.action("robot1", number) for number in about[slots[1]]} == {None}


def test_unknown_numbers_raise() -> None:
    world, other = World("synchronous/01"), World("multi_agent/01")
    count = len(world.ground_actions("robot1"))
    for wrong in (-1, count):
        with pytest.raises(WrongArgumentError, match=f"{count} actions, found number {wrong}"):
            world.initial.action("robot1", wrong)
    with pytest.raises(UnknownNameError, match="did you mean 'robot1'"):
        world.initial.action("robot9", 0)
    with pytest.raises(UnknownNameError, match="robot1 has no ground action"):
        world.initial.action_number(other.ground_actions("robot2")[0], "robot1")


def test_numbers_are_equal_in_all_worlds_of_a_task() -> None:
    one, two = World("asynchronous/07"), World("asynchronous/07")
    state = played(one, 4, 60)[-1]
    twin = two.unpack(one.pack(state))
    two.make_room_for_another()
    assert one.encoding.columns == two.encoding.columns
    assert np.array_equal(state.vector(), twin.vector())
    assert np.array_equal(state.mask("robot1"), twin.mask("robot1"))
    for action in state.actions("robot1"):
        assert state.action_number(action) == twin.action_number(action)


def many_waters(world: World, number: int) -> State:
    """Return a state with this number of created objects."""
    world.make_room({"water": number})
    bits = [world.table.bit["~exists", f"water{i}"] for i in range(1, number + 1)]
    return State(world, world.initial.facts | sum(bits), world.initial.timers)


def test_too_many_created_objects_raise_with_advice() -> None:
    world = World("asynchronous/07")
    room = len(world.encoding.slots.by_kind["water"])
    assert many_waters(world, room).vector().any()
    full = many_waters(world, room + 1)
    for ask in (full.vector, full.graph, lambda: full.mask("robot1")):
        with pytest.raises(SlotOverflowError) as caught:
            ask()
        assert f"World(task, slots={{'water': {room + 1}}})" in str(caught.value)
        again = pickle.loads(pickle.dumps(caught.value))
        assert (again.kind, again.found, again.slots) == ("water", room + 1, room)


def test_number_of_slots_can_be_chosen() -> None:
    world = World("asynchronous/07", slots={"water": 7})
    assert many_waters(world, 7).vector().any()
    usual = World("asynchronous/07")
    assert world.encoding.size > usual.encoding.size
    assert Encoding(usual, {"water": 7}).columns == world.encoding.columns
    state = world.initial
    for twin in (copy.deepcopy(state), pickle.loads(pickle.dumps(state))):
        assert len(twin.vector()) == world.encoding.size
        assert twin == state
    for wrong, words in (
        ({"wine": 1}, "play cannot create objects of kind 'wine'"),
        ({"water": 0}, "expected 1 or more"),
    ):
        with pytest.raises(RobotouilleError, match=words):
            _ = World("asynchronous/07", slots=wrong).encoding


WITHOUT = """
import sys
for name in ("gymnasium", "numpy", "pettingzoo"):
    sys.modules[name] = None
from robotouille import World
from robotouille.errors import MissingExtraError
world = World("synchronous/01")
assert world.unpack(world.pack(world.initial)) == world.initial
for ask in (world.initial.vector, world.initial.graph, lambda: world.initial.mask("robot1"),
            lambda: world.ground_actions("robot1"), lambda: __import__("robotouille.envs")):
    try:
        ask()
    except MissingExtraError as error:
        assert "pip install 'robotouille[rl]'" in str(error)
    else:
        raise AssertionError(ask)
"""


@pytest.mark.process
def test_missing_numpy_names_the_extra() -> None:
    subprocess.run([sys.executable, "-c", WITHOUT], check=True)


def test_too_many_actions_and_facts_for_memory_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kitchen of 70 equal objects took 1.2 GiB, and larger ones would take all memory."""
    monkeypatch.setattr(reachable, "MAX_BITS", 10_000)
    world = World("multi_agent/01")
    with pytest.raises(TooHardError, match="too many objects for arrays"):
        world.ground_actions("robot1")
