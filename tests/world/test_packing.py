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
