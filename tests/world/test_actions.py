"""Ground actions as values: equality, copies, pickles, sentences."""

import copy
import pickle

import pytest

from robotouille import GroundAction, World, load_task
from tests.world.kitchens import bolt_recycler, full_pot, kitchen


def move(world: World) -> GroundAction:
    return world.action("move", "robot1", "table3", "table1")


def test_copies_are_the_same_object() -> None:
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
def test_actions_of_another_world_of_the_task_are_accepted(name: str) -> None:
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


def test_states_of_another_world_of_the_task_are_accepted() -> None:
    there = World("asynchronous/06")
    state = full_pot()
    action = there.action("move", "robot1", "sink1", "table1")
    assert there.step(state, action).state == state.step(action).state
    assert there.step(state, action).state.world is there


def test_action_about_a_created_object_can_be_sent_to_a_new_world() -> None:
    world = bolt_recycler()
    world.make_room({"bolt": 7})
    action = world.action("grab", "fitter1", "bolt7", "dispenser1")
    fresh = World(world.task)
    assert "bolt7" not in fresh.thing_names
    attempt = fresh.initial.step(action).attempts[0]
    assert attempt.action == action
    assert "bolt7 does not exist" in attempt.reasons


def test_pickles_of_other_tasks_contain_the_task() -> None:
    world = kitchen()
    twin = pickle.loads(pickle.dumps(world.initial))
    assert twin == world.initial
    assert twin.world.task == world.task
    action = world.initial.actions("robot1")[0]
    assert pickle.loads(pickle.dumps(action)) == action


def test_pickles_keep_seats_and_timing() -> None:
    task = load_task("multi_agent/01@3", timing="people")
    world = World(task)
    assert pickle.loads(pickle.dumps(world)).task == task


# Sentences


def test_step_accepts_a_sentence() -> None:
    world = World("synchronous/01")
    state, said = world.initial, "move ROBOT1  from table3 to table1"
    step = state.step(said)
    assert step == state.step(move(world))
    assert state.step([said]) == state.step([None, said]) == state.step({"robot1": said}) == step


def test_step_accepts_sentences_of_a_team() -> None:
    world = World("multi_agent/01@2")
    joint = [world.initial.actions(player)[0] for player in world.players]
    expected = world.initial.step(joint)
    assert world.initial.step([action.sentence for action in joint]) == expected
    assert world.initial.step([joint[0], joint[1].sentence]) == expected
    said = {player: a.sentence for player, a in zip(world.players, joint, strict=True)}
    assert world.initial.step(said) == expected


def test_step_without_actions() -> None:
    state = full_pot()
    nothing = state.step([])
    assert state.step(None) == state.step([None]) == state.step({"robot1": None}) == nothing
    assert nothing.attempts == ()
