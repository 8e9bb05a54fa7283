"""The timing profile for people: walks take their way, delays are longer, cuts take a while."""

import pytest

from robotouille import State, World, load_task
from tests.world.kitchens import act, kitchen, waiting

LETTUCE = {"name": "lettuce", "x": 2, "y": 0, "predicates": ["iscuttable"]}
PATTY = {"name": "patty", "x": 3, "y": 0, "predicates": ["iscookable"]}


def at(x: int) -> list[dict[str, object]]:
    return [{"name": "robot", "x": x, "y": 1, "direction": [0, -1]}]


def busy_steps(state: State) -> list[int]:
    """Return the number of steps for which robot1 stays busy."""
    found = [state.busy_steps("robot1")]
    while found[-1]:
        state = waiting(state, 1)
        found.append(state.busy_steps("robot1"))
    return found


@pytest.mark.parametrize(
    ("there", "busy"),
    [("table2", [0]), ("board1", [1, 0]), ("stove1", [2, 1, 0]), ("sink1", [4, 3, 2, 1, 0])],
)
def test_walk_takes_one_step_for_each_tile(there: str, busy: list[int]) -> None:
    world = kitchen(timing="people", players=at(0))
    state = act(world.initial, "move", "robot1", "table1", there)
    assert busy_steps(state) == busy


def test_walk_goes_around_stations() -> None:
    wall = [{"name": "table", "x": 2, "y": y} for y in range(4)]
    ends = [{"name": "stove", "x": 1, "y": 0}, {"name": "sink", "x": 3, "y": 0}]
    world = kitchen(timing="people", players=at(1), stations=[*wall, *ends])
    state = act(world.initial, "move", "robot1", "stove1", "sink1")
    assert busy_steps(state)[0] == 8 - 1


def test_busy_player_has_no_actions_and_gets_the_reason() -> None:
    world = kitchen(timing="people", players=at(0))
    state = act(world.initial, "move", "robot1", "table1", "sink1")
    assert state.actions("robot1") == ()
    back = world.action("move", "robot1", "sink1", "table1")
    assert not world.applicable(state, back)
    result = state.step(back)
    assert result.attempts[0].reasons == ("robot1 is busy for 4 more steps",)
    assert result.state == waiting(state, 1)
    last = waiting(state, 3).step(back)
    assert last.attempts[0].reasons == ("robot1 is busy for 1 more step",)
    assert waiting(state, 4).step(back).attempts[0].applied


def test_busy_player_cannot_wait() -> None:
    """`wait` has no player argument, so the acting player counts."""
    world = kitchen(timing="people", players=at(0))
    state = act(world.initial, "move", "robot1", "table1", "sink1")
    result = state.step({"robot1": world.action("wait")})
    assert result.attempts[0].reasons == ("robot1 is busy for 4 more steps",)


@pytest.mark.parametrize(("config", "steps"), [({}, 15), ({"default": 1}, 5), ({"default": 0}, 0)])
def test_delays_are_five_times_longer(config: dict[str, int], steps: int) -> None:
    world = kitchen(timing="people", items=[PATTY], players=at(3), config={"cook_time": config})
    state = act(world.initial, "cook", "robot1", "patty1", "stove1")
    assert state.busy_steps("robot1") == 0
    assert [waiting(state, n).holds("iscooked", "patty1") for n in range(17)] == [
        n >= steps for n in range(17)
    ]


def test_cut_takes_two_steps() -> None:
    state = kitchen(timing="people", items=[LETTUCE], players=at(2)).initial
    for number in range(3):
        assert not state.holds("iscut", "lettuce1"), number
        state = act(state, "cut", "robot1", "lettuce1", "board1")
        assert busy_steps(state) == [1, 0]
        assert state.actions("robot1") == ()
        state = waiting(state, 1)
    assert state.holds("iscut", "lettuce1")


def test_timing_profiles_give_different_digests() -> None:
    one, other = (load_task("multi_agent/01", timing=t) for t in ("benchmark", "people"))
    assert one.problem == other.problem
    assert one.digest != other.digest
    assert World(one).initial.fact_names() == World(other).initial.fact_names()
