"""Orders of a shift arrive, are served, and expire, in `World.step`."""

from __future__ import annotations

import json
import pickle
import random
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from robotouille.domain.task import Task
from robotouille.errors import FileError, RobotouilleError, WrongArgumentError, WrongWorldError
from robotouille.planning import AnytimePlanner, solve
from robotouille.protocol.states import StateReader, StateWriter
from robotouille.world.shift import OpenOrder, Orders
from robotouille.world.world import State, World
from tests.support.shifts import (
    BISTRO,
    TOAST_ACTIONS,
    act,
    bistro,
    example,
    file_of,
    toast_almost,
)

WORLD = World(example())


def orders_of(state: State) -> Orders:
    assert state.orders is not None
    return state.orders


DERIVED = {rule.predicate for rule in WORLD.task.domain.layout or () if rule.unless}


def derived(world: World, state: State) -> set[tuple[str, ...]]:
    """Compute the facts that hold unless others do, one by one."""
    atoms, found = state.atoms(), set()
    types = {p.name: p.param_types for p in world.task.domain.predicate_defs}
    for rule in world.task.domain.layout or ():
        if rule.unless:
            taken = {name for atom in atoms if atom[0] in rule.unless for name in atom[1:]}
            things = (o.name for o in state.objects if o.type == types[rule.predicate][0])
            found |= {(rule.predicate, name) for name in things if name not in taken}
    return found


# Serving


def test_served_dish_earns_points_and_a_tip_for_the_patience_that_is_left(tmp_path: Path) -> None:
    state = toast_almost(bistro(tmp_path))
    result = state.step("Stack bread2 onto plate1 at hatch1 with robot1")
    orders = orders_of(result.state)
    assert orders.time == 8
    assert result.points == 10 + 8 * 72 // 80 == result.reward
    assert (orders.score, orders.served, orders.expired) == (17, 1, 0)
    assert orders.open == (OpenOrder(1, 100),)


def test_served_things_return_and_plates_must_be_washed(tmp_path: Path) -> None:
    world = bistro(tmp_path)
    state = act(toast_almost(world), "Stack bread2 onto plate1 at hatch1 with robot1")
    soiled = {*world.initial.atoms()} - {("isclean", "plate1")}
    there = {atom for atom in state.atoms() if atom[0] not in ("loc", "vacant")}
    assert there == {atom for atom in soiled if atom[0] not in ("loc", "vacant")}
    state = act(
        state,
        "Move robot1 from hatch1 to rack1",
        "Pick up plate1 at rack1 with robot1",
        "Move robot1 from rack1 to sink1",
        "Put down plate1 at sink1 with robot1",
        "Start washing plate1 at sink1 with robot1",
        None,
        None,
    )
    assert state.holds("isclean", "plate1")


def test_dirty_plate_and_extra_things_are_not_served(tmp_path: Path) -> None:
    world = bistro(tmp_path)
    state = toast_almost(world).without([("isclean", "plate1")])
    state = act(state, "Stack bread2 onto plate1 at hatch1 with robot1")
    assert orders_of(state).served == 0
    state = toast_almost(world)
    # The dish has only one slice of bread.
    more = [("has_item", "robot1", "bread2"), ("nothing", "robot1")]
    assert all(state.holds(*atom) == (atom[0] == "has_item") for atom in more)
    on_hatch = {"bread1": ("item_at", "bread1", "hatch1"), "top": ("atop", "bread1", "plate1")}
    facts = state.facts
    for atom in (("item_at", "bread1", "crate1"), ("item_on", "bread1", "crate1")):
        facts &= ~world.table.bit[atom]
    facts &= ~world.table.bit["clear", "plate1"]
    for atom in on_hatch.values():
        facts |= world.table.bit[atom]
    crowded = world.restore(facts, (), (), orders_of(state).row)
    crowded = act(crowded, "Stack bread2 onto bread1 at hatch1 with robot1")
    assert orders_of(crowded).served == 0


def test_soup_is_served_in_its_bowl_which_returns_empty(tmp_path: Path) -> None:
    world = bistro(tmp_path)
    state = act(
        world.initial,
        "Move robot1 from sink1 to stove1",
        "Pick up pot1 at stove1 with robot1",
        "Move robot1 from stove1 to sink1",
        "Put down pot1 at sink1 with robot1",
        "Start filling pot1 with water at sink1 with robot1",
        None,
        "Move robot1 from sink1 to crate2",
        "Pick up onion1 at crate2 with robot1",
        "Move robot1 from crate2 to sink1",
    )
    adding = next(a for a in state.actions("robot1") if a.name == "add-to")
    state = state.step(adding).state
    state = act(
        state,
        "Move robot1 from sink1 to table1",
        "Pick up bowl1 at table1 with robot1",
        "Move robot1 from table1 to hatch1",
        "Put down bowl1 at hatch1 with robot1",
        "Move robot1 from hatch1 to sink1",
        "Pick up pot1 at sink1 with robot1",
        "Move robot1 from sink1 to hatch1",
    )
    pouring = next(a for a in state.actions("robot1") if a.name == "fill-bowl")
    result = state.step(pouring)
    assert result.points == 30
    after = result.state
    assert {thing.name for thing in after.objects}.isdisjoint({"water1"})
    assert after.holds("container_at", "bowl1", "table1")
    assert after.holds("container_empty", "bowl1")
    assert after.holds("item_on", "onion1", "crate2")
    assert after.holds("station_empty", "hatch1")
    assert after.holds("has_container", "robot1", "pot1")
    # The table of atoms must not grow with each soup.
    assert world.used_objects(after.facts) == []


def test_discarded_things_return_as_dirty_as_they_are(tmp_path: Path) -> None:
    world = bistro(tmp_path)
    start = act(world.initial, "Move robot1 from sink1 to rack1", TOAST_ACTIONS[0])
    for state, clean in ((start, True), (start.without([("isclean", "plate1")]), False)):
        after = act(
            state,
            "Move robot1 from rack1 to bin1",
            "Put down plate1 at bin1 with robot1",
        )
        assert after.holds("item_on", "plate1", "rack1")
        assert after.holds("clear", "plate1")
        assert after.holds("isclean", "plate1") == clean
        assert after.holds("station_empty", "bin1")
        assert orders_of(after).score == 0


def test_thing_whose_place_is_taken_goes_to_an_empty_table(tmp_path: Path) -> None:
    world = bistro(tmp_path)
    state = act(
        world.initial,
        "Move robot1 from sink1 to table1",
        "Pick up bowl1 at table1 with robot1",
        "Move robot1 from table1 to hatch1",
        "Put down bowl1 at hatch1 with robot1",
        "Move robot1 from hatch1 to crate1",
        "Lift bread2 off bread1 at crate1 with robot1",
        "Move robot1 from crate1 to table1",
        "Put down bread2 at table1 with robot1",
        "Move robot1 from table1 to hatch1",
        "Pick up bowl1 at hatch1 with robot1",
        "Move robot1 from hatch1 to bin1",
        "Put down bowl1 at bin1 with robot1",
    )
    assert state.holds("container_at", "bowl1", "table2")
    assert state.holds("item_on", "bread2", "table1")
    assert {atom for atom in state.atoms() if atom[0] in DERIVED} == derived(world, state)


def test_large_pile_on_the_hatch_is_judged_at_once(tmp_path: Path) -> None:
    goal = [
        {"predicate": "item_at", "args": ["bread", "hatch"], "ids": [i, 0]} for i in range(1, 10)
    ]
    menu = {"nine slices": {"goal": goal, "points": 1, "patience": 90}}
    problem = file_of(menu=menu, arrivals=[{"at": 0, "dish": "nine slices"}])
    crate = {"x": 0, "y": 4}
    slices = [{"name": "bread", **crate, "stack-level": level} for level in range(16)]
    problem["objects"]["item"] = slices
    path = tmp_path / "pile.json"
    path.write_text(json.dumps(problem))
    world = World(str(path))
    state = world.initial

    def pile(count: int) -> State:
        moved = [f"bread{number}" for number in range(1, count + 1)]
        facts = state.facts & ~world.table.matching(("atop", None, None))
        for name in moved:
            facts &= ~world.table.bit["item_at", name, "crate1"]
            facts |= world.table.bit["item_at", name, "hatch1"]
        return world.restore(facts, (), (), orders_of(state).row)

    assert [orders_of(pile(count).step(None).state).served for count in (8, 9, 16)] == [0, 1, 0]


# Arrival and expiry


def test_orders_expire_with_a_penalty(tmp_path: Path) -> None:
    state = bistro(tmp_path).initial
    for time in range(1, 101):
        state = state.step(None).state
        assert orders_of(state).expired == (time >= 80) + (time >= 100)
    assert orders_of(state) == Orders(100, (), 2, -7, 0, 2)


def test_orders_wait_while_too_many_are_open(tmp_path: Path) -> None:
    arrivals = [{"at": at, "dish": "toast"} for at in (0, 3, 4)]
    state = bistro(tmp_path, arrivals=arrivals, most_open=1).initial
    seen = []
    for _ in range(165):
        state = state.step(None).state
        seen.append(orders_of(state))
    assert max(len(orders.open) for orders in seen) == 1
    assert [orders.open[0].due for orders in seen[78:81]] == [80, 160, 160]
    assert seen[-1].arrived == 3


def test_nothing_changes_after_the_end_of_a_shift(tmp_path: Path) -> None:
    state = bistro(tmp_path, steps=5).initial
    for _ in range(5):
        assert not state.shift_over
        state = state.step(None).state
    assert state.shift_over
    assert orders_of(state.step(None).state) == orders_of(state)


def test_seed_draws_the_orders_whatever_the_players_do() -> None:
    def drawn(seed: int) -> Any:
        return Task.to_json(example(seed=seed))["problem"]["shift"]["arrivals"]

    assert drawn(1) == drawn(1) != drawn(2)
    assert Task.from_json(example(seed=1).to_json()).digest == example(seed=1).digest
    times = [order["at"] for order in drawn(3)]
    assert times[0] == 0
    assert all(12 <= later - at <= 20 for at, later in pairwise(times))


def test_times_follow_the_timing_profile() -> None:
    slow = World(example(timing="people"))
    assert slow.shift is not None and WORLD.shift is not None
    assert slow.shift.steps == 5 * WORLD.shift.steps
    assert orders_of(slow.initial).open[0].due == 5 * orders_of(WORLD.initial).open[0].due


# States


def walk(world: World, seed: int, steps: int) -> list[State]:
    choice, states = random.Random(seed), [world.initial]
    for _ in range(steps):
        valid = [states[-1].actions(player) for player in world.players]
        # Half of the actions are not walks, so that things move.
        work = [[a for a in each if a.destination is None] or list(each) for each in valid]
        chosen = [choice.choice(one or [None]) for one in work if choice.random() < 0.8]
        states.append(states[-1].step([action for action in chosen if action]).state)
    return states


@pytest.mark.parametrize("seed", range(5))
def test_states_of_random_play_are_sound_and_survive_every_form(seed: int) -> None:
    writer = StateWriter(WORLD)
    reader = StateReader(WORLD, writer.tables(WORLD.initial), writer.values(WORLD.initial))
    other = World(example())
    names = {thing.name for thing in WORLD.initial.objects}
    before = WORLD.initial
    for state in walk(WORLD, seed, 40)[1:]:
        assert {thing.name for thing in state.objects} == names
        assert {atom for atom in state.atoms() if atom[0] in DERIVED} == derived(WORLD, state)
        for item in (o.name for o in state.objects if o.type == "item"):
            held = sum(state.holds("has_item", player, item) for player in WORLD.players)
            places = sum(atom[:2] == ("item_at", item) for atom in state.atoms())
            assert held + places == 1
        assert reader.apply(writer.changes(before, state)) == state
        assert pickle.loads(pickle.dumps(state)) == state
        assert other.unpack(WORLD.pack(state)).digest == state.digest
        before = state


def test_states_with_other_orders_differ(tmp_path: Path) -> None:
    world = bistro(tmp_path)
    one, other = world.initial, world.initial.step(None).state
    assert one.facts == other.facts
    assert one != other
    assert one.digest != other.digest


@pytest.mark.parametrize(
    ("row", "error"),
    [
        (5, WrongArgumentError),
        ([0, [], 0, 0, 0], WrongArgumentError),
        ([0, [[0]], 1, 0, 0, 0], WrongArgumentError),
        ([0, [], 0, "many", 0, 0], WrongArgumentError),
        ([True, [], 0, 0, 0, 0], WrongArgumentError),
        ([-1, [], 0, 0, 0, 0], WrongWorldError),
        ([10**9, [], 0, 0, 0, 0], WrongWorldError),
        ([0, [], 10**9, 0, 0, 0], WrongWorldError),
        ([0, [[7, 10]], 1, 0, 0, 0], WrongWorldError),
        ([0, [[0, 10], [0, 10]], 2, 0, 0, 0], WrongWorldError),
        ([0, [[i, 10] for i in range(4)], 4, 0, 0, 0], WrongWorldError),
        ([0, [[0, 10**6]], 1, 0, 0, 0], WrongWorldError),
        ([0, [], 2, 0, 3, -1], WrongWorldError),
        ([0, [], 2, 0, 1, 0], WrongWorldError),
    ],
)
def test_orders_from_outside_are_checked(row: Any, error: type[RobotouilleError]) -> None:
    with pytest.raises(error):
        WORLD.restore(WORLD.initial.facts, (), (), row)


def test_tasks_without_a_shift_have_no_orders() -> None:
    world = World("synchronous/01")
    assert world.initial.orders is None
    with pytest.raises(WrongWorldError, match="no shift"):
        world.restore(world.initial.facts, (), (), orders_of(WORLD.initial).row)


def test_text_has_the_menu_and_the_orders() -> None:
    text = WORLD.initial.step(None).state.text_view("robot1")
    assert "- cheese sandwich (20 points, up to 10 more if it is early; 5 less" in text
    assert "  - some cheese lies directly on bread A" in text
    assert "Orders (step 1 of 120; 0 points, 0 served, 0 expired):" in text
    assert "sandwich: 69 steps left" in text
    assert "Goal conditions" not in text


def test_searches_refuse_a_shift() -> None:
    for search in (lambda: solve(WORLD), lambda: AnytimePlanner(WORLD)):
        with pytest.raises(RobotouilleError, match="a shift, which has no goal; plan its dishes"):
            search()


# Files


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"menu": {}}, r"shift\.menu"),
        ({"arrivals": [{"at": 0, "dish": "soop"}]}, "unknown dish 'soop'"),
        ({"arrivals": []}, "arrivals"),
        ({"arrivals": {"every": [9, 3]}}, "the interval 9 to 3 is empty"),
        (
            {
                "arrivals": [
                    {"at": 5, "dish": "cheese sandwich"},
                    {"at": 2, "dish": "cheese sandwich"},
                ]
            },
            "not sorted",
        ),
        ({"serve": {"station": "hatsch", "predicates": ["item_at"]}}, "did you mean 'hatch'"),
        ({"serve": {"station": "hatch", "predicates": ["iscut"]}}, "does not relate a thing"),
        ({"serve": {"station": "hatch", "predicates": ["itemat"]}}, "unknown predicate 'itemat'"),
        (
            {"serve": {"station": "hatch", "predicates": ["item_at"], "soils": ["atop"]}},
            "does not describe a single thing",
        ),
        ({"discard": "ben"}, "no station 'ben'"),
        ({"discard": "hatch"}, "dishes are served at these stations"),
        ({"steps": 5000, "arrivals": {"every": [1, 1]}}, "5,000 orders; at most 1,000"),
        ({"steps": 0}, r"shift\.steps"),
    ],
)
def test_faults_of_files_are_named(tmp_path: Path, changes: dict[str, Any], fault: str) -> None:
    path = tmp_path / "shift.json"
    path.write_text(json.dumps(file_of(**changes)))
    with pytest.raises(FileError, match=fault):
        World(str(path))


def test_things_that_could_not_return_are_named(tmp_path: Path) -> None:
    problem = file_of()
    problem["objects"]["item"][3] |= {"x": 2, "y": 3}
    path = tmp_path / "shift.json"
    path.write_text(json.dumps(problem))
    with pytest.raises(FileError, match=r"objects\.item\[3\]: 'bread' is not on a station"):
        World(str(path))


def test_faults_of_a_dish_name_the_dish(tmp_path: Path) -> None:
    problem = file_of()
    problem["shift"]["menu"]["cheese sandwich"]["goal"][0]["predicate"] = "item_under"
    path = tmp_path / "shift.json"
    path.write_text(json.dumps(problem))
    with pytest.raises(FileError, match=r"menu\['cheese sandwich'\].goal\[0\].predicate"):
        World(str(path))


def test_file_has_either_a_goal_or_a_shift(tmp_path: Path) -> None:
    path = tmp_path / "shift.json"
    both = {**file_of(), "goal": BISTRO["shift"]["menu"]["toast"]["goal"]}
    neither = {key: value for key, value in file_of().items() if key != "shift"}
    for problem, fault in ((both, "a shift has no goal"), (neither, "needs a 'goal'")):
        path.write_text(json.dumps(problem))
        with pytest.raises(FileError, match=fault):
            World(str(path))
