"""A step is a function of a state and a joint action; what is rejected changes nothing."""

import random

import pytest

from robotouille import InapplicableError, State, World, load_task
from robotouille.world.unmet import Unmet, UnmetKind
from tests.world.differential import all_actions
from tests.world.kitchens import act, kitchen, play, waiting

PATTY = {"name": "patty", "x": 0, "y": 0, "predicates": ["iscookable"]}
TWO_PLAYERS = [
    {"name": "robot", "x": 0, "y": 1, "direction": [0, -1]},
    {"name": "robot", "x": 2, "y": 1, "direction": [0, -1]},
]


def nearest_states(world: World, count: int) -> list[State]:
    """Some states, nearest first."""
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
def test_equal_inputs_give_equal_results_in_worlds_with_another_past(name: str) -> None:
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


def test_the_order_of_a_joint_action_decides_who_gets_the_place() -> None:
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


def test_independent_actions_commute() -> None:
    world = kitchen(players=TWO_PLAYERS)
    first = world.action("move", "robot1", "table1", "table2")
    second = world.action("move", "robot2", "board1", "stove1")
    assert world.initial.step([first, second]).state == world.initial.step([second, first]).state


def test_an_action_can_use_what_the_one_before_it_made_true() -> None:
    world = kitchen(players=TWO_PLAYERS)
    leave = world.action("move", "robot1", "table1", "table2")
    follow = world.action("move", "robot2", "board1", "table1")
    assert all(a.applied for a in world.initial.step([leave, follow]).attempts)
    assert not world.initial.step([follow, leave]).attempts[0].applied


def test_a_player_acts_once_in_a_step() -> None:
    world = kitchen(items=[PATTY])
    take = world.parse(world.initial, "robot1", "Pick up patty1 at table1 with robot1")
    walk = world.action("move", "robot1", "table1", "table2")
    result = world.initial.step([take, walk])
    assert [a.applied for a in result.attempts] == [True, False]
    assert result.attempts[1].reasons == ("robot1 has acted in this step already",)
    waits = {"robot1": world.action("wait")}
    assert world.initial.step(waits).attempts[0].applied


@pytest.mark.parametrize("name", ["synchronous/01", "workshop/01", "asynchronous/06"])
def test_rejected_actions_change_nothing_and_say_why(name: str) -> None:
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


def test_reasons_are_in_words() -> None:
    world = kitchen(items=[PATTY])
    cook = world.action("cook", "robot1", "patty1", "stove1")
    assert tuple(map(str, world.unmet(world.initial, cook))) == (
        "needs: robot1 stands at stove1",
        "needs: patty1 lies directly on stove1",
    )
    board = world.action("cook", "robot1", "patty1", "table1")
    (unmet,) = world.unmet(world.initial, board)
    kind = UnmetKind.CONDITION
    assert unmet == Unmet(kind, "needs: table1 is a stove", "isstove", ("table1",))


def test_unknown_names_are_refused_with_the_nearest() -> None:
    world = kitchen(items=[PATTY])
    with pytest.raises(KeyError, match="did you mean 'move'"):
        world.action("mov")
    with pytest.raises(KeyError, match="did you mean 'patty1'"):
        world.action("cook", "robot1", "paty1", "stove1")
    with pytest.raises(KeyError, match="'stove1' is a station"):
        world.action("cook", "robot1", "stove1", "patty1")
    with pytest.raises(KeyError, match=r"takes .*found 1"):
        world.action("move", "robot1")
    with pytest.raises(KeyError, match="did you mean 'robot1'"):
        world.initial.actions("robot")
    with pytest.raises(KeyError, match="did you mean 'Move robot1 from table1 to table2'"):
        world.parse(world.initial, "robot1", "Move robot1 from table1 to tabel2")


def test_sentences_are_read_whatever_their_case_and_blanks() -> None:
    world = kitchen()
    action = world.parse(world.initial, "robot1", "  move ROBOT1 from table1\tto table2 ")
    assert (action.name, action.arguments) == ("move", ("robot1", "table1", "table2"))


def test_contradictory_conditions_never_hold_even_for_one_object_twice() -> None:
    """`stack` needs the lower thing clear; nothing may be stacked onto itself."""
    world = kitchen(items=[{**PATTY, "x": 0, "y": 1}])
    state = world.initial
    assert state.holds("has_item", "robot1", "patty1")
    itself = world.parse(state, "robot1", "Put down patty1 at table1 with robot1")
    on_table = state.step(itself).state
    stack = world.action("stack", "robot1", "patty1", "patty1", "table1")
    assert not world.applicable(on_table, stack)
    assert stack not in on_table.actions("robot1")


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


def test_a_reward_marks_the_step_that_reaches_the_goal() -> None:
    goal = [{"predicate": "item_on", "args": ["patty", "table"], "ids": [1, 2]}]
    held = [{**PATTY, "x": 0, "y": 1}]
    world = kitchen(items=held, goal=goal)
    idle = world.initial.step([])
    assert (idle.reward, idle.goal_reached) == (0.0, False)
    place = world.parse(world.initial, "robot1", "Put down patty1 at table1 with robot1")
    result = world.initial.step(place)
    assert (result.reward, result.goal_reached) == (1.0, True)
    assert result.state.goal_reached


def test_the_valid_actions_of_the_first_state_in_order() -> None:
    state = kitchen(items=[PATTY]).initial
    assert [a.sentence for a in state.actions("robot1")] == [
        "Move robot1 from table1 to table2",
        "Move robot1 from table1 to board1",
        "Move robot1 from table1 to stove1",
        "Move robot1 from table1 to stove2",
        "Move robot1 from table1 to sink1",
        "Pick up patty1 at table1 with robot1",
        "Do nothing",
    ]
    assert play(state, "Do nothing") == state


@pytest.mark.parametrize("timing", ["benchmark", "people"])
@pytest.mark.parametrize("name", ["multi_agent/01@2", "multi_agent/07@3", "multi_agent/10@4"])
def test_the_fast_path_of_several_players_is_a_step(name: str, timing: str) -> None:
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
