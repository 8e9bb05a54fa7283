"""Actions: equality, pickling and usefulness."""

import copy
import pickle

import pytest

from robotouille import GroundAction, State, World, load_task
from robotouille.world.presentation.work import (
    changes_something,
    useful_actions,
    work_in_progress,
)
from tests.support.scripted import BOILING, POT_AT_SINK, after
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


CUTTING = ["move table9", "pick-up-item", "move board1", "place-item", "cut"]
COOKING = ["move table11", "pick-up-item chicken1", "move stove1", "place-item", "cook"]


def useless(state: State) -> list[str]:
    player = state.world.players[0]
    useful = useful_actions(state, player)
    return [action.name for action in state.actions(player) if action not in useful]


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([], []),
        (CUTTING, []),
        ([*CUTTING, "cut", "cut"], ["cut"]),
        ([*COOKING, "-", "-", "-", "-"], ["cook"]),
        (POT_AT_SINK, ["fill-pot"]),
        (BOILING, ["boil-water"]),
        ([*BOILING, "-", "-", "-", "-"], ["boil-water"]),
    ],
)
def test_useless_actions(lines: list[str], expected: list[str]) -> None:
    assert useless(after("asynchronous/09", *lines)) == expected


def test_in_another_domain() -> None:
    lines = ["grab gear1", "walk anvil1", "drop", "hammer"]
    assert useless(after("workshop/01", *lines)) == []
    assert useless(after("workshop/01", *lines, "hammer")) == ["hammer"]


def test_waiting_counts_as_useful() -> None:
    state = World("asynchronous/09").initial
    assert changes_something(state, state.world.action("wait"))


def test_useless_progress_is_hidden() -> None:
    cutting = after("asynchronous/09", *CUTTING)
    assert work_in_progress(cutting) == cutting.progress() != ()
    again = after("asynchronous/09", *CUTTING, "cut", "cut", "cut", "cut")
    assert again.progress()
    assert work_in_progress(again) == ()
    boiling = after("asynchronous/09", *BOILING)
    assert [row.action for row in work_in_progress(boiling)] == ["boil-water"]
