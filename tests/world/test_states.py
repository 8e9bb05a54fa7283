"""States are values: equal, hashed, pickled and digested alike, wherever they come from."""

import copy
import os
import pickle
import subprocess
import sys

import pytest

from robotouille import World, load_task
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
