"""States that travel as their own bytes."""

from __future__ import annotations

import random
from dataclasses import replace

import msgpack
import pytest

from robotouille import RobotouilleError, World, WrongArgumentError, WrongWorldError, load_task
from tests.world.kitchens import STATES

MAX_BYTES = 400


@pytest.mark.parametrize("name", STATES)
def test_a_packed_state_is_the_same_in_another_world_of_its_task(name: str) -> None:
    state = STATES[name]()
    data = state.world.pack(state)
    twin = World(state.world.task).unpack(data)
    assert twin == state
    assert twin.digest == state.digest
    assert len(data) <= MAX_BYTES


@pytest.mark.parametrize("task", ["asynchronous/10", "multi_agent/10@4"])
def test_states_of_tasks_that_are_not_shipped_are_no_larger(task: str) -> None:
    world = World(replace(load_task(task), name="mine"))
    state, rng = world.initial, random.Random(1)
    for _ in range(100):
        state = state.step([rng.choice(state.actions(player)) for player in world.players]).state
        assert len(world.pack(state)) <= MAX_BYTES


def test_what_is_no_packed_state() -> None:
    world, other = World("synchronous/01"), World("synchronous/02")
    data = world.pack(world.initial)
    with pytest.raises(WrongWorldError, match="another task than synchronous/02"):
        other.unpack(data)
    for wrong in (b"", b"nonsense", data[:-1], data + b"x", msgpack.packb([9, b"", b"", [], []])):
        with pytest.raises(WrongArgumentError, match="expected a packed state"):
            world.unpack(wrong)


def test_changed_bytes_never_make_anything_else_than_a_state() -> None:
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
    "a player that is none": ((), (("nobody", 1),)),
    "a player busy for ever": ((), (("robot1", -1),)),
    "a player busy often": ((), (("robot1", 1),) * 2),
    "a player busy for a name": ((), (("robot1", "table1"),)),
    "an action that is none": ((("a" * 1_000_000, 0, (), ()),), ()),
    "an object that is none": ((("cook", 0, ("nothing", "stove1"), (0,)),), ()),
    "half a row": ((("cook", 0),), ()),
    "an index that is none": ((("cook", "x", ("patty1", "stove1"), (0,)),), ()),
    "arguments that are none": ((("cook", 0, ({}, "stove1"), (0,)),), ()),
    "counters that are none": ((("cook", 0, ("patty1", "stove1"), ("x",)),), ()),
    "no rows": (5, "x"),
}


@pytest.mark.parametrize("name", HOSTILE_ROWS)
def test_timers_that_no_state_has_are_refused_in_a_line(name: str) -> None:
    world = World("synchronous/01")
    version, mark, facts, *_ = msgpack.unpackb(world.pack(world.initial))
    data = msgpack.packb([version, mark, facts, *HOSTILE_ROWS[name]])
    with pytest.raises(RobotouilleError) as caught:
        world.unpack(data)
    assert len(str(caught.value)) < 300


def test_few_bytes_do_not_make_a_world_grow_for_ever() -> None:
    world = World("synchronous/01")
    version, mark, _, *rows = msgpack.unpackb(world.pack(world.initial))
    with pytest.raises(WrongWorldError, match="more than 500 created objects"):
        world.unpack(msgpack.packb([version, mark, b"\xff" * 4_000, *rows]))
    assert len(world.all_objects()) <= len(world.placed) + 2 * 501


def test_facts_about_an_object_that_is_not_there_are_of_no_state() -> None:
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
