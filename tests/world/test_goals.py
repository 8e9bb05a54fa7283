"""Goals: when they hold, and how quickly that is decided."""

from typing import Any

import pytest

from tests.world.kitchens import act, kitchen, waiting


def item(name: str, x: int, level: int = 0, **more: Any) -> dict[str, Any]:
    return {"name": name, "x": x, "y": 0, "stack-level": level, **more}


def term(predicate: str, *pairs: tuple[str, int | str]) -> dict[str, Any]:
    return {
        "predicate": predicate,
        "args": [kind for kind, _ in pairs],
        "ids": [identifier for _, identifier in pairs],
    }


def holds(*goal: dict[str, Any], **fields: Any) -> bool:
    return kitchen(goal=list(goal), **fields).initial.goal_reached


STACK = [item("bread", 0), item("lettuce", 0, 1), item("bread", 0, 2)]
APART = [item("bread", 0), item("lettuce", 1), item("bread", 2)]


def test_equal_ids_are_one_object() -> None:
    on_table = term("item_on", ("bread", 1), ("table", 2))
    clear = term("clear", ("bread", 1))
    other = term("clear", ("bread", 3))
    assert holds(on_table, items=STACK)
    assert not holds(on_table, clear, items=STACK)
    assert holds(on_table, other, items=STACK)
    assert holds(on_table, clear, items=APART)


def test_different_ids_of_a_kind_are_different_objects() -> None:
    goal = [term("clear", ("bread", 1)), term("clear", ("bread", 2))]
    assert holds(*goal, items=APART)
    assert not holds(*goal, items=STACK)
    tables = [term("item_on", ("bread", 1), ("table", n)) for n in (2, 3)]
    assert not holds(*tables, items=APART)


def test_type_name_matches_any_object_of_the_type() -> None:
    assert holds(term("item_on", ("item", 1), ("board", 2)), items=APART)
    assert holds(term("item_on", ("lettuce", 1), ("station", 2)), items=APART)
    assert not holds(term("item_on", ("item", 1), ("stove", 2)), items=APART)
    two = [term("atop", ("item", 1), ("item", 2)), term("atop", ("item", 3), ("item", 1))]
    assert holds(*two, items=STACK)
    three = [*two, term("atop", ("item", 4), ("item", 3))]
    assert not holds(*three, items=STACK)


def test_type_name_may_match_an_object_of_another_id() -> None:
    """Only ids of one kind have to differ."""
    both = [term("clear", ("lettuce", 1)), term("clear", ("item", 2))]
    assert holds(*both, items=[item("lettuce", 0)])
    assert not holds(*both, term("clear", ("item", 3)), items=[item("lettuce", 0)])


def test_string_id_is_the_object_with_this_id() -> None:
    items = [item("bread", 0, id="left"), item("bread", 1, id="right"), item("lettuce", 1, 1)]
    assert holds(term("clear", ("bread", "left")), items=items)
    assert not holds(term("clear", ("bread", "right")), items=items)
    assert holds(term("atop", ("item", 1), ("bread", "right")), items=items)
    assert not holds(term("clear", ("bread", "left")), term("clear", ("bread", 1)), items=items)


def test_first_kind_of_an_id_is_used() -> None:
    goal = [term("clear", ("cheese", 1)), term("item_on", ("lettuce", 1), ("table", 2))]
    assert holds(*goal, items=[item("cheese", 0)])
    assert not holds(*goal, items=[item("lettuce", 0)])


def test_empty_goal_holds() -> None:
    assert holds()


def test_goals_can_have_static_facts() -> None:
    assert holds(
        term("iscuttable", ("lettuce", 1)), items=[item("lettuce", 0, predicates=["iscuttable"])]
    )
    assert not holds(term("iscuttable", ("lettuce", 1)), items=[item("lettuce", 0)])


def test_static_fact_about_another_kind_is_no_part_of_the_goal() -> None:
    world = kitchen(goal=[term("isboard", ("table", 1))])
    assert not world.initial.goal_reached
    assert world.goal.fit(world.initial.facts).holding == (False,)


def test_created_objects_satisfy_goals_while_they_exist() -> None:
    goal = [term("in", ("water", 1), ("pot", 2))]
    cook = [{"name": "robot", "x": 5, "y": 1, "direction": [0, -1]}]
    world = kitchen(goal=goal, containers=[{"name": "pot", "x": 5, "y": 0}], players=cook)
    state = act(world.initial, "fill-pot", "robot1", "pot1", "sink1")
    assert [waiting(state, n).goal_reached for n in range(5)] == [False] * 3 + [True] * 2
    assert not world.initial.goal_reached


@pytest.mark.parametrize("last_is_cut", [True, False])
def test_goal_of_many_equal_objects_is_matched_quickly(last_is_cut: bool) -> None:
    """Trying all 12! × 12! assignments of tomatoes and tables would never end."""
    count = 12
    done = [["iscut"]] * (count - 1) + [["iscut"] if last_is_cut else []]
    goal = [
        wanted
        for i in range(count)
        for wanted in (
            term("iscut", ("tomato", i)),
            term("item_on", ("tomato", i), ("table", 100 + i)),
        )
    ]
    world = kitchen(
        width=count,
        stations=[{"name": "table", "x": x, "y": 0} for x in range(count)],
        items=[item("tomato", x, predicates=done[x]) for x in range(count)],
        goal=goal,
    )
    assert world.initial.goal_reached is last_is_cut


@pytest.mark.slow
def test_display_of_a_hard_goal_ends() -> None:
    """Each of a thousand conditions would search through all others."""
    held = [{"predicate": "item_at", "args": ["bread", "table"], "ids": [1, 2]}] * 500
    never = [{"predicate": "atop", "args": ["bread", "bread"], "ids": [3, 4]}] * 500
    places = [(x, y) for x in range(0, 60, 2) for y in range(0, 60, 2)][:40]
    world = kitchen(
        width=60, height=60, goal=held + never,
        stations=[{"name": "table", "x": x, "y": y} for x, y in places],
        items=[{"name": "bread", "x": x, "y": y} for x, y in places],
        players=[{"name": "robot", "x": 1, "y": 1, "direction": [0, -1]}],
    )  # fmt: skip
    shown = [holds for _, holds in world.goal_terms(world.initial)]
    assert shown == [True] * 500 + [False] * 500
