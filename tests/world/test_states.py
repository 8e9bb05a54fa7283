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
    kitchen,
    play,
    waiting,
)

# A program that reads a pickled state, plays on, and answers with another one.
CHILD = """
import pickle, sys
state = pickle.load(sys.stdin.buffer)
after = state.step(state.actions(state.world.players[-1])[0]).state
sys.stdout.buffer.write(pickle.dumps((state.digest, state, after.digest, after)))
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
def test_states_travel_between_processes(name: str, seed: str) -> None:
    state = STATES[name]()
    answer = subprocess.run(
        [sys.executable, "-c", CHILD],
        input=pickle.dumps(state),
        stdout=subprocess.PIPE,
        check=True,
        env={**os.environ, "PYTHONHASHSEED": seed},
    )
    digest, twin, digest_after, after = pickle.loads(answer.stdout)
    assert digest == state.digest
    assert twin == state
    here = state.step(state.actions(state.world.players[-1])[0]).state
    assert (after, after.digest) == (here, digest_after)


def test_different_states_differ() -> None:
    filling, full = filling_pot(), full_pot()
    assert filling != full
    assert filling.digest != full.digest
    assert waiting(filling, 1) != filling
    assert waiting(filling, 1).facts == filling.facts
    assert filling != "a state"


def test_created_objects_have_names_facts_and_text() -> None:
    state = full_pot()
    assert state.holds("in", "water1", "pot1")
    assert state.holds("iswater", "water1")
    assert not state.holds("container_empty", "pot1")
    assert "Meal water1:" in state.text()
    assert "water" not in filling_pot().text().split("Valid Actions")[0]


def test_courses_of_play_in_one_world_do_not_disturb_each_other() -> None:
    """What one branch creates exists in no other, nor changes what the other sees."""
    world = World(load_task("asynchronous/06"))
    before = (world.initial.text(), world.initial.digest, world.initial.atoms())
    full = waiting(play(world.initial, *FILL), 3)
    assert (world.initial.text(), world.initial.digest, world.initial.atoms()) == before
    assert [o.type for o in world.initial.objects].count("meal") == 0
    again = waiting(play(world.initial, *FILL), 3)
    assert again == full
    assert again.digest == full.digest


SECOND_POT = [
    {"name": "pot", "x": 5, "y": 0},
    {"name": "pot", "x": 4, "y": 0},
]


def test_each_created_object_gets_the_next_number() -> None:
    cook = [{"name": "robot", "x": 5, "y": 1, "direction": [0, -1]}]
    world = kitchen(containers=SECOND_POT, players=cook, config={"fill_time": {"default": 0}})
    state = play(
        world.initial,
        "Start filling pot2 with water at sink1 with robot1",
        "Pick up pot2 at sink1 with robot1",
        "Move robot1 from sink1 to table1",
        "Put down pot2 at table1 with robot1",
        "Move robot1 from table1 to stove2",
        "Pick up pot1 at stove2 with robot1",
        "Move robot1 from stove2 to sink1",
        "Put down pot1 at sink1 with robot1",
        "Start filling pot1 with water at sink1 with robot1",
    )
    assert state.holds("in", "water1", "pot2")
    assert state.holds("in", "water2", "pot1")
    assert [o.name for o in state.objects if o.type == "meal"] == ["water1", "water2"]
    assert pickle.loads(pickle.dumps(state)) == state


def test_the_name_of_a_deleted_object_is_never_given_again() -> None:
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


def test_a_state_with_a_long_past_is_restored_in_a_fresh_world() -> None:
    """However many objects have come and gone."""
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


@pytest.mark.parametrize(
    ("rows", "fault"),
    [
        ([("no-such-action", 0, ("patty1",), (0,))], KeyError),
        ([("cook", 99, ("patty1", "stove1"), (0, 0))], ValueError),
        ([("cook", -1, ("patty1", "stove1"), (0, 0))], ValueError),
        ([("cook", 0, ("patty1",), (0, 0))], ValueError),
        ([("cook", 0, ("patty1", "oven1"), (0, 0))], KeyError),
        ([("cook", 0, ("patty1", "stove1"), (0, 0, 0))], ValueError),
    ],
)
def test_timers_of_another_world_are_refused(rows: list, fault: type[Exception]) -> None:
    world = kitchen(items=[{"name": "patty", "x": 0, "y": 0, "predicates": ["iscookable"]}])
    with pytest.raises(fault):
        world.restore(world.initial.facts, rows)


def test_facts_of_another_world_are_refused() -> None:
    world = World(load_task("synchronous/01"))
    assert world.restore(world.initial.facts, []) == world.initial
    for facts in (-1, 1 << 10_000):
        with pytest.raises(ValueError, match="another world"):
            world.restore(facts, [])
