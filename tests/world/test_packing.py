"""States packed into bytes."""

from __future__ import annotations

import random

import msgpack
import pytest

from robotouille import RobotouilleError, World, WrongArgumentError, WrongWorldError
from tests.world.kitchens import STATES

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


def test_few_bytes_cannot_make_a_world_grow_without_limit() -> None:
    world = World("synchronous/01")
    version, mark, _, *rows = msgpack.unpackb(world.pack(world.initial))
    with pytest.raises(WrongWorldError, match="more than 500 created objects"):
        world.unpack(msgpack.packb([version, mark, b"\xff" * 4_000, *rows]))
    assert len(world.all_objects()) <= len(world.placed) + 2 * 501


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
