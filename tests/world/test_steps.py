"""A step is a function of a state and a joint action; what is rejected changes nothing."""

import random

import pytest

from robotouille import InapplicableError, State, World, load_task
from tests.world.differential import all_actions
from tests.world.kitchens import act, kitchen, waiting

PATTY = {"name": "patty", "x": 0, "y": 0, "predicates": ["iscookable"]}
TWO_PLAYERS = [
    {"name": "robot", "x": 0, "y": 1, "direction": [0, -1]},
    {"name": "robot", "x": 2, "y": 1, "direction": [0, -1]},
]


def nearest_states(world: World, count: int) -> list[State]:
    """Return some reachable states, nearest first."""
    found = {world.initial: None}
    for state in (queue := list(found)):
        for action in (a for p in world.players for a in state.actions(p)):
            after = state.step(action).state
            if after not in found:
                found[after] = None
                queue.append(after)
        if len(found) >= count:
            break
    return list(found)[:count]


@pytest.mark.parametrize("name", ["asynchronous/06", "workshop/02", "multi_agent/01@2"])
def test_equal_steps_give_equal_results_in_used_worlds(name: str) -> None:
    fresh, used = World(load_task(name)), World(load_task(name))
    nearest_states(used, 30)
    state, twin = fresh.initial, used.initial
    for _ in range(15):
        action = state.actions(fresh.players[-1])[-1]
        state = state.step(action).state
        twin = twin.step(used.action(action.name, *action.arguments)).state
        assert state.digest == twin.digest
        assert state == twin
        assert hash(state) == hash(twin)
        assert state.text() == twin.text()


def test_order_of_a_joint_action_decides_conflicts() -> None:
    world = kitchen(players=TWO_PLAYERS)
    first = world.action("move", "robot1", "table1", "table2")
    second = world.action("move", "robot2", "board1", "table2")
    one = world.initial.step([first, second])
    other = world.initial.step([second, first])
    assert [a.applied for a in one.attempts] == [True, False]
    assert one.state.holds("loc", "robot1", "table2")
    assert one.attempts[1].reasons == ("needs: table2 has nobody standing at it",)
    assert other.state.holds("loc", "robot2", "table2")
    assert one.state == world.initial.step(first).state


def test_later_action_sees_results_of_earlier_action() -> None:
    world = kitchen(players=TWO_PLAYERS)
    leave = world.action("move", "robot1", "table1", "table2")
    follow = world.action("move", "robot2", "board1", "table1")
    assert all(a.applied for a in world.initial.step([leave, follow]).attempts)
    assert not world.initial.step([follow, leave]).attempts[0].applied


def test_player_acts_once_in_a_step() -> None:
    world = kitchen(items=[PATTY])
    take = world.parse(world.initial, "robot1", "Pick up patty1 at table1 with robot1")
    walk = world.action("move", "robot1", "table1", "table2")
    result = world.initial.step([take, walk])
    assert [a.applied for a in result.attempts] == [True, False]
    assert result.attempts[1].reasons == ("robot1 has already acted in this step",)
    waits = {"robot1": world.action("wait")}
    assert world.initial.step(waits).attempts[0].applied


@pytest.mark.parametrize("name", ["synchronous/01", "workshop/01", "asynchronous/06"])
def test_rejected_actions_change_nothing_and_have_reasons(name: str) -> None:
    world = World(load_task(name))
    actions = all_actions(world)
    for state in nearest_states(world, 6):
        idle = state.step([])
        valid = set(state.actions(world.players[0]))
        for action in actions:
            assert world.applicable(state, action) == (action in valid)
            if action not in valid:
                result = state.step(action)
                assert result.state == idle.state
                assert not result.attempts[0].applied
                assert result.attempts[0].unmet
                with pytest.raises(InapplicableError) as error:
                    world.successor(state, action)
                assert error.value.unmet == result.attempts[0].unmet


def test_changes_are_the_facts_of_the_step() -> None:
    world = kitchen(items=[PATTY])
    after = act(world.initial, "pick-up-item", "robot1", "patty1", "table1")
    added, removed = world.changes(world.initial, after)
    assert set(added) == {("has_item", "robot1", "patty1"), ("station_empty", "table1")}
    assert set(removed) == {
        ("nothing", "robot1"),
        ("item_at", "patty1", "table1"),
        ("item_on", "patty1", "table1"),
        ("clear", "patty1"),
    }
    assert world.changes(after, waiting(after, 5)) == ([], [])


def test_reward_marks_the_step_that_reaches_the_goal() -> None:
    goal = [{"predicate": "item_on", "args": ["patty", "table"], "ids": [1, 2]}]
    held = [{**PATTY, "x": 0, "y": 1}]
    world = kitchen(items=held, goal=goal)
    idle = world.initial.step([])
    assert (idle.reward, idle.goal_reached) == (0.0, False)
    place = world.parse(world.initial, "robot1", "Put down patty1 at table1 with robot1")
    result = world.initial.step(place)
    assert (result.reward, result.goal_reached) == (1.0, True)
    assert result.state.goal_reached


@pytest.mark.parametrize("timing", ["benchmark", "people"])
@pytest.mark.parametrize("name", ["multi_agent/01@2", "multi_agent/07@3", "multi_agent/10@4"])
def test_fast_path_for_several_players_equals_a_step(name: str, timing: str) -> None:
    world, rng = World(load_task(name, timing=timing)), random.Random(3)
    state = world.initial
    for _ in range(150):
        actions = [
            rng.choice([None, *world.actions(earlier, player), *state.actions(player)])
            for player in world.players
            for earlier in (world.initial, state)[rng.randrange(2) :][:1]
        ]
        step = state.step(actions)
        after, applied = world.joint_successor(state, actions)
        assert after == step.state
        attempts = iter(step.attempts)
        assert applied == tuple(a is None or next(attempts).applied for a in actions)
        state = after
