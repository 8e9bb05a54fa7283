"""States are values, and caches do not change them."""

import copy
import gc
import os
import pickle
import random
import subprocess
import sys
from itertools import product
from weakref import WeakSet

import msgpack
import pytest

from robotouille import RobotouilleError, World, WrongArgumentError, WrongWorldError, load_task
from robotouille.world import timers
from robotouille.world.grounding import goal, ground_task, successors
from tests.support.samples import quick_sample
from tests.world.differential import WALKS, walk_both
from tests.world.kitchens import (
    FILL,
    STATES,
    act,
    bolt_recycler,
    filling_pot,
    full_pot,
    play,
    waiting,
)

# A program that reads a pickled state, plays on, and answers with another one.
CHILD = """
import pickle, sys
state = pickle.load(sys.stdin.buffer)
actions = state.actions(state.world.players[-1])
after = state.step(actions[0]).state
sys.stdout.buffer.write(pickle.dumps((state.digest, state, actions, after.digest, after)))
"""


@pytest.mark.parametrize("name", STATES)
def test_copies_are_equal(name: str) -> None:
    state = STATES[name]()
    for twin in (pickle.loads(pickle.dumps(state)), copy.copy(state), copy.deepcopy(state)):
        assert twin == state
        assert hash(twin) == hash(state)
        assert twin.digest == state.digest
        assert twin.text() == state.text()
        assert {state: 1}[twin] == 1


@pytest.mark.process
@pytest.mark.parametrize("seed", ["1", "2"])
@pytest.mark.parametrize("name", STATES)
def test_states_can_be_sent_between_processes(name: str, seed: str) -> None:
    state = STATES[name]()
    answer = subprocess.run(
        [sys.executable, "-c", CHILD],
        input=pickle.dumps(state),
        stdout=subprocess.PIPE,
        check=True,
        env={**os.environ, "PYTHONHASHSEED": seed},
    )
    digest, twin, actions, digest_after, after = pickle.loads(answer.stdout)
    assert digest == state.digest
    assert twin == state
    expected = state.actions(state.world.players[-1])
    assert actions == expected
    assert [hash(action) for action in actions] == [hash(action) for action in expected]
    here = state.step(expected[0]).state
    assert (after, after.digest) == (here, digest_after)


def test_different_states_differ() -> None:
    filling, full = filling_pot(), full_pot()
    assert filling != full
    assert filling.digest != full.digest
    assert waiting(filling, 1) != filling
    assert waiting(filling, 1).facts == filling.facts
    assert filling != "a state"


def test_episodes_in_one_world_are_independent() -> None:
    """Objects created in one episode neither exist in another nor change it."""
    world = World(load_task("asynchronous/06"))
    before = (world.initial.text(), world.initial.digest, world.initial.atoms())
    full = waiting(play(world.initial, *FILL), 3)
    assert (world.initial.text(), world.initial.digest, world.initial.atoms()) == before
    assert [o.type for o in world.initial.objects].count("meal") == 0
    again = waiting(play(world.initial, *FILL), 3)
    assert again == full
    assert again.digest == full.digest


def test_name_of_a_deleted_object_is_not_reused() -> None:
    """A bolt that was recycled is not the next one from the dispenser."""
    world = bolt_recycler()
    state = waiting(act(world.initial, "dispense", "fitter1", "dispenser1"), 1)
    first = state
    assert [o.name for o in state.objects if o.kind == "bolt"] == ["bolt1"]
    state = act(state, "grab", "fitter1", "bolt1", "dispenser1")
    state = act(state, "recycle", "fitter1", "bolt1", "dispenser1")
    assert [o.name for o in state.objects if o.kind == "bolt"] == []
    assert not [atom for atom in state.atoms() if "bolt1" in atom]
    state = waiting(act(state, "dispense", "fitter1", "dispenser1"), 1)
    assert [o.name for o in state.objects if o.kind == "bolt"] == ["bolt2"]
    assert state.digest != first.digest
    grab = world.action("grab", "fitter1", "bolt1", "dispenser1")
    assert state.step(grab).attempts[0].reasons[0] == "bolt1 does not exist"


def test_state_after_many_creations_is_restored_in_a_new_world() -> None:
    """The number of deleted objects does not matter."""
    world = bolt_recycler()
    state = world.initial
    for number in range(1, 9):
        state = waiting(act(state, "dispense", "fitter1", "dispenser1"), 1)
        last = state
        state = act(state, "grab", "fitter1", f"bolt{number}", "dispenser1")
        state = act(state, "recycle", "fitter1", f"bolt{number}", "dispenser1")
    for past in (last, state):
        twin = World(world.task).restore(past.facts, past.timer_rows())
        assert twin.digest == past.digest
        assert twin.text() == past.text()


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


MAX_BYTES = 400


@pytest.mark.parametrize("name", STATES)
def test_packed_state_is_restored_in_another_world(name: str) -> None:
    state = STATES[name]()
    data = state.world.pack(state)
    twin = World(state.world.task).unpack(data)
    assert twin == state
    assert twin.digest == state.digest
    assert len(data) <= MAX_BYTES


def test_invalid_bytes_raise() -> None:
    world, other = World("synchronous/01"), World("synchronous/02")
    data = world.pack(world.initial)
    with pytest.raises(WrongWorldError, match="not of the task synchronous/02"):
        other.unpack(data)
    for wrong in (b"", b"nonsense", data[:-1], data + b"x", msgpack.packb([9, b"", b"", [], []])):
        with pytest.raises(WrongArgumentError, match="expected a packed state"):
            world.unpack(wrong)


def test_changed_bytes_raise_or_give_a_state() -> None:
    world, rng = World("asynchronous/07"), random.Random(7)
    data = world.pack(world.initial)
    for _ in range(500):
        changed = bytearray(data)
        changed[rng.randrange(len(data))] = rng.randrange(256)
        try:
            state = world.unpack(bytes(changed))
        except RobotouilleError:
            continue
        assert state.world is world


HOSTILE_ROWS = {
    "an unknown player": ((), (("nobody", 1),)),
    "a player busy for ever": ((), (("robot1", -1),)),
    "a player busy often": ((), (("robot1", 1),) * 2),
    "a player busy for a name": ((), (("robot1", "table1"),)),
    "an unknown action": ((("a" * 1_000_000, 0, (), ()),), ()),
    "an unknown object": ((("cook", 0, ("nothing", "stove1"), (0,)),), ()),
    "half a row": ((("cook", 0),), ()),
    "an unknown index": ((("cook", "x", ("patty1", "stove1"), (0,)),), ()),
    "invalid arguments": ((("cook", 0, ({}, "stove1"), (0,)),), ()),
    "invalid counters": ((("cook", 0, ("patty1", "stove1"), ("x",)),), ()),
    "no rows": (5, "x"),
}


@pytest.mark.parametrize("name", HOSTILE_ROWS)
def test_invalid_timers_raise(name: str) -> None:
    world = World("synchronous/01")
    version, mark, facts, *_ = msgpack.unpackb(world.pack(world.initial))
    data = msgpack.packb([version, mark, facts, *HOSTILE_ROWS[name]])
    with pytest.raises(RobotouilleError) as caught:
        world.unpack(data)
    assert len(str(caught.value)) < 300


@pytest.mark.slow
def test_few_bytes_cannot_make_a_world_grow_without_limit() -> None:
    world = World("synchronous/01")
    version, mark, _, *rows = msgpack.unpackb(world.pack(world.initial))
    with pytest.raises(WrongWorldError, match="more than 500 created objects"):
        world.unpack(msgpack.packb([version, mark, b"\xff" * 4_000, *rows]))
    assert len(world.all_objects()) <= len(world.placed) + 2 * 501


def test_a_world_keeps_only_some_of_the_effects_that_no_state_uses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ground_task, "MAX_EFFECTS", 10)
    world = World("asynchronous/05")
    items = ("onion1", "onion2", "patty1", "cheese1", "bottombun1", "topbun1")
    stations = ("table1", "table2", "table3", "stove1", "board1", "fryer1")
    rows = [("cook", 0, pair, (0, 1)) for pair in product(items, stations)]
    kept = [world.restore(world.initial.facts, [row]) for row in rows[:3]]
    effects = WeakSet(entry[0] for state in kept for entry in state.timers.entries)
    for row in rows:
        effects.update(e for e, _ in world.restore(world.initial.facts, [row]).timers.entries)
        assert len(effects) <= 10
    again = [world.restore(world.initial.facts, [row]) for row in rows[:3]]
    assert [state.timers for state in again] == [state.timers for state in kept]


def test_facts_about_missing_objects_raise() -> None:
    world = World("asynchronous/10")
    bits = [
        world.table.bit[atom]
        for atom in world.table.atoms
        if "water1" in atom[1:] and not atom[0].startswith("~")
    ]
    assert bits
    for bit in bits:
        with pytest.raises(WrongWorldError, match="water1, which does not exist"):
            world.restore(world.initial.facts | bit, ())
