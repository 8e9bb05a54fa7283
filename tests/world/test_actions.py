"""Ground actions are values: equal by name and arguments, copied, pickled, read from sentences."""

import copy
import os
import pickle
import subprocess
import sys

import pytest

from robotouille import GroundAction, World, load_task
from tests.world.kitchens import bolt_recycler, full_pot, kitchen, play

CHILD = """
import pickle, sys
state, actions = pickle.load(sys.stdin.buffer)
after = state.step(actions[0])
sys.stdout.buffer.write(pickle.dumps((after.state.digest, actions, after.attempts)))
"""


def move(world: World) -> GroundAction:
    return world.action("move", "robot1", "table3", "table1")


def test_copies_are_the_same_action() -> None:
    action = move(World("synchronous/01"))
    for twin in (pickle.loads(pickle.dumps(action)), copy.copy(action), copy.deepcopy(action)):
        assert twin == action
        assert hash(twin) == hash(action)
        assert {action: 1}[twin] == 1
        assert str(twin) == str(action)


def test_actions_of_two_worlds_are_equal() -> None:
    here, there = World("synchronous/01"), World("synchronous/01")
    assert move(here) == move(there)
    assert move(here) is not move(there)
    assert len({move(here), move(there)}) == 1
    assert move(here) != here.action("move", "robot1", "table3", "table2")
    assert move(here) != "move(robot1, table3, table1)"
    assert move(there) in here.initial.actions("robot1")


@pytest.mark.parametrize("name", ["synchronous/01", "asynchronous/06", "multi_agent/01@2"])
def test_a_world_takes_the_actions_of_another_of_its_task(name: str) -> None:
    here, there = World(name), World(name)
    state = here.initial
    for number in range(40):
        actions = state.actions(here.players[number % len(here.players)])
        action = actions[(number * 7) % len(actions)]
        elsewhere = there.action(action.name, *action.arguments)
        step, twin = state.step(action), state.step([elsewhere])
        assert step == twin
        assert twin.state.world is here
        state = step.state


def test_a_world_takes_the_states_of_another_of_its_task() -> None:
    there = World("asynchronous/06")
    state = full_pot()
    action = there.action("move", "robot1", "sink1", "table1")
    assert there.step(state, action).state == state.step(action).state
    assert there.step(state, action).state.world is there


def test_an_action_about_a_created_object_travels_to_a_world_that_has_no_room_for_it() -> None:
    world = bolt_recycler()
    world.make_room({"bolt": 7})
    action = world.action("grab", "fitter1", "bolt7", "dispenser1")
    fresh = World(world.task)
    assert "bolt7" not in fresh.thing_names
    attempt = fresh.initial.step(action).attempts[0]
    assert attempt.action == action
    assert "bolt7 does not exist" in attempt.reasons


@pytest.mark.process
@pytest.mark.parametrize("seed", ["1", "2"])
def test_actions_travel_between_processes(seed: str) -> None:
    state = full_pot()
    actions = state.actions("robot1")
    answer = subprocess.run(
        [sys.executable, "-c", CHILD],
        input=pickle.dumps((state, actions)),
        stdout=subprocess.PIPE,
        check=True,
        env={**os.environ, "PYTHONHASHSEED": seed},
    )
    digest, there, attempts = pickle.loads(answer.stdout)
    step = state.step(actions[0])
    assert (digest, there, attempts) == (step.state.digest, actions, step.attempts)
    assert [hash(action) for action in there] == [hash(action) for action in actions]


def test_states_and_actions_of_shipped_tasks_are_small() -> None:
    """They say which task is theirs, and do not carry it along."""
    state = full_pot()
    assert len(pickle.dumps(state)) < 300
    assert len(pickle.dumps(state.actions("robot1")[0])) < 300


def test_states_of_other_tasks_carry_theirs() -> None:
    world = kitchen()
    twin = pickle.loads(pickle.dumps(world.initial))
    assert twin == world.initial
    assert twin.world.task == world.task
    action = world.initial.actions("robot1")[0]
    assert pickle.loads(pickle.dumps(action)) == action


def test_seats_and_timing_travel_too() -> None:
    task = load_task("multi_agent/01@3", timing="people")
    world = World(task)
    assert pickle.loads(pickle.dumps(world)).task == task


# Sentences


def test_a_step_takes_a_sentence() -> None:
    world = World("synchronous/01")
    state, said = world.initial, "move ROBOT1  from table3 to table1"
    step = state.step(said)
    assert step == state.step(move(world))
    assert state.step([said]) == state.step([None, said]) == state.step({"robot1": said}) == step


def test_a_team_takes_sentences() -> None:
    world = World("multi_agent/01@2")
    joint = [world.initial.actions(player)[0] for player in world.players]
    expected = world.initial.step(joint)
    assert world.initial.step([action.sentence for action in joint]) == expected
    assert world.initial.step([joint[0], joint[1].sentence]) == expected
    said = {player: a.sentence for player, a in zip(world.players, joint, strict=True)}
    assert world.initial.step(said) == expected


def test_nothing_is_a_step_too() -> None:
    state = full_pot()
    nothing = state.step([])
    assert state.step(None) == state.step([None]) == state.step({"robot1": None}) == nothing
    assert nothing.attempts == ()


def test_a_plan_of_sentences_is_played() -> None:
    state = World("asynchronous/06").initial
    said = ("Move robot1 from table3 to table2", "Pick up pot1 at table2 with robot1")
    assert state.step(said[0]).state.step(said[1]).state == play(state, *said)
