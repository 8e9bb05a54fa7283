"""Failure taxonomy on trajectories that each fail in one known way."""

from __future__ import annotations

from dataclasses import replace

import pytest

from robotouille import World, load_task
from robotouille_evaluation.metrics import Category, Trajectory, classify
from robotouille_evaluation.metrics.failure_kinds import CATEGORIES, Subcategory
from robotouille_evaluation.metrics.failures import evidence
from tests.evaluation.metrics.courses import SANDWICH, refused, solo, wandering
from tests.world.kitchens import kitchen

LETTUCE_SANDWICH = World(load_task("synchronous/02"))
"""lettuce1 on table2, bread1 on table3, bread2 on table4; the cook at table5; board1."""

BREAD_ON_BOARD = (
    "Move robot1 from table5 to table3",
    "Pick up bread1 at table3 with robot1",
    "Move robot1 from table3 to board1",
    "Put down bread1 at board1 with robot1",
    "Move robot1 from board1 to table2",
    "Pick up lettuce1 at table2 with robot1",
    "Move robot1 from table2 to board1",
)
"""Afterwards the board is occupied and the lettuce is in hand."""
UNCUT_LETTUCE_ON_BREAD = (
    "Move robot1 from table5 to table2",
    "Pick up lettuce1 at table2 with robot1",
    "Move robot1 from table2 to table3",
    "Stack lettuce1 onto bread1 at table3 with robot1",
)


def with_rejected(course: Trajectory, *texts: str, reasoning: str = "") -> Trajectory:
    """Return the trajectory with rejected answers at its end."""
    wrong = refused(course, course.steps, *texts, reasoning=reasoning)
    return replace(course, answers=(*course.answers, *wrong))


def with_reasoning(text: str, *later: str) -> Trajectory:
    """Return a trajectory whose first answer has a reasoning."""
    course = solo(LETTUCE_SANDWICH, "Move robot1 from table5 to table2", *later)
    first, *others = course.answers
    return replace(course, answers=(replace(first, reasoning=text), *others))


def found(course: Trajectory, budget: int = 100) -> tuple[Category, Subcategory]:
    failure = classify(course, budget)
    assert failure is not None
    assert failure.category is CATEGORIES[failure.subcategory]
    return failure.category, failure.subcategory


def test_success_is_not_classified() -> None:
    goal = [{"predicate": "item_on", "args": ["cheese", "table"], "ids": [1, 2]}]
    items = [{"name": "cheese", "x": 0, "y": 0}]
    assert classify(solo(kitchen(items=items, goal=goal)), 0) is None


def test_run_that_ended_early() -> None:
    assert found(wandering(), 12) == (Category.OTHER, Subcategory.NOT_PLAYED)


def test_two_items_at_the_board() -> None:
    course = solo(LETTUCE_SANDWICH, *BREAD_ON_BOARD)
    wrong = ["Put down lettuce1 at board1 with robot1"] * 3
    failure = classify(with_rejected(course, *wrong), 20)
    assert failure is not None
    assert failure.subcategory is Subcategory.ONE_ITEM
    assert failure.category is Category.TRANSITION
    assert failure.steps == (7,)
    assert len(failure.evidence) == 3


def test_stacked_items_at_the_board() -> None:
    course = solo(
        LETTUCE_SANDWICH, *BREAD_ON_BOARD, "Stack lettuce1 onto bread1 at board1 with robot1"
    )
    course = with_rejected(course, "Make a cut in lettuce1 at board1 with robot1")
    assert found(course) == (Category.TRANSITION, Subcategory.ONE_ITEM)
    assert {each.step for each in evidence(course)} == {7, 8}


def test_loop_at_the_board() -> None:
    """Case of the appendix: the agent clears a station and occupies it again, and so on."""
    pick, put = "Pick up bread1 at board1 with robot1", "Put down bread1 at board1 with robot1"
    course = solo(LETTUCE_SANDWICH, *BREAD_ON_BOARD[:4], *[pick, put] * 4)
    failure = classify(course, course.steps)
    assert failure is not None
    assert (failure.category, failure.subcategory) == (Category.TRANSITION, Subcategory.ONE_ITEM)
    assert failure.steps == (9, 10, 11)
    short = solo(LETTUCE_SANDWICH, *BREAD_ON_BOARD[:4], pick, put)
    assert evidence(short) == []


@pytest.mark.parametrize(
    ("text", "subcategory"),
    [
        ("Transfer lettuce1 to bread1", Subcategory.INVALID_ACTION),
        ("Make a cut in lettuce1 at table2 with robot1", Subcategory.INVALID_ACTION),
        ("Pick up bread2 at table4 with robot1", Subcategory.INVALID_ACTION),
        ("Pick up lettuce1 at board1 with robot1", Subcategory.INVALID_ACTION),
        ("Pick up bread1 at board1 with robot1", Subcategory.ONE_IN_HAND),
        ("Put down lettuce1 at board1 with robot1", Subcategory.ONE_ITEM),
    ],
)
def test_rule_that_a_rejected_answer_breaks(text: str, subcategory: Subcategory) -> None:
    course = with_rejected(solo(LETTUCE_SANDWICH, *BREAD_ON_BOARD), text)
    assert [each.subcategory for each in evidence(course)] == [subcategory]
    assert found(course) == (CATEGORIES[subcategory], subcategory)


def test_violations_of_both_rules() -> None:
    texts = ("Pick up bread1 at board1 with robot1", "Put down lettuce1 at board1 with robot1")
    course = with_rejected(solo(LETTUCE_SANDWICH, *BREAD_ON_BOARD), *texts)
    assert found(course) == (Category.TRANSITION, Subcategory.BOTH_RULES)


def test_goal_outweighs_recovered_mistakes() -> None:
    """Case of the appendix: rules were violated and the goal misunderstood."""
    course = solo(
        LETTUCE_SANDWICH,
        *UNCUT_LETTUCE_ON_BREAD,
        "Move robot1 from table3 to table4",
        "Pick up bread2 at table4 with robot1",
    )
    assert found(course) == (Category.GOAL, Subcategory.INGREDIENT)
    early = refused(course, 2, "Pick up bread2 at table4 with robot1")
    course = replace(course, answers=(*course.answers[:2], *early, *course.answers[2:]))
    assert found(course) == (Category.GOAL, Subcategory.INGREDIENT)


def test_preparation_of_the_lower_thing_is_forgotten() -> None:
    course = solo(
        LETTUCE_SANDWICH,
        "Move robot1 from table5 to table4",
        "Pick up bread2 at table4 with robot1",
        "Move robot1 from table4 to table2",
        "Stack bread2 onto lettuce1 at table2 with robot1",
    )
    assert found(course) == (Category.GOAL, Subcategory.INGREDIENT)


def test_corrected_mistakes_are_not_goal_failures() -> None:
    course = solo(
        LETTUCE_SANDWICH,
        *UNCUT_LETTUCE_ON_BREAD,
        "Lift lettuce1 off bread1 at table3 with robot1",
    )
    assert [each.lasting for each in evidence(course)] == [False]


def test_false_claims() -> None:
    course = with_reasoning("Bread, lettuce. lettuce1 is already cut.")
    assert found(course) == (Category.STATE, Subcategory.PREDICATES)


@pytest.mark.parametrize(
    "reasoning",
    [
        "lettuce1 is not cut, and the bread is near.",
        "Once lettuce1 is cut I put it on the bread.",
        "The bread is cut. Lettuce must be cut.",
    ],
)
def test_statements_that_are_not_false_claims(reasoning: str) -> None:
    assert not evidence(with_reasoning(reasoning))


def test_bad_start() -> None:
    failure = classify(with_reasoning("The goal: bread on bread.", "Do nothing"), 2)
    assert failure is not None
    assert failure.subcategory is Subcategory.BAD_START
    assert failure.evidence[0].words == "the first reasoning does not name: lettuce"


def test_reasoning_without_goal_is_not_a_bad_start() -> None:
    assert evidence(with_reasoning("The bread is over there.")) == []


def test_wrong_ingredient() -> None:
    items = [
        {"name": "bread", "x": 0, "y": 0},
        {"name": "tomato", "x": 1, "y": 0},
        {"name": "cheese", "x": 2, "y": 0},
    ]
    goal = [{"predicate": "atop", "args": ["cheese", "bread"], "ids": [1, 2]}]
    course = solo(
        kitchen(items=items, goal=goal),
        "Move robot1 from table1 to table2",
        "Pick up tomato1 at table2 with robot1",
        "Move robot1 from table2 to table1",
        "Stack tomato1 onto bread1 at table1 with robot1",
    )
    assert found(course) == (Category.GOAL, Subcategory.INGREDIENT)


def test_wrong_order() -> None:
    items = [{"name": "bread", "x": 0, "y": 0}, {"name": "cheese", "x": 1, "y": 0}]
    goal = [{"predicate": "atop", "args": ["cheese", "bread"], "ids": [1, 2]}]
    course = solo(
        kitchen(items=items, goal=goal),
        "Pick up bread1 at table1 with robot1",
        "Move robot1 from table1 to table2",
        "Stack bread1 onto cheese1 at table2 with robot1",
    )
    assert found(course) == (Category.GOAL, Subcategory.ORDER)


def test_right_order_is_not_evidence() -> None:
    assert evidence(wandering()) == []


def test_rejection_out_of_turn_is_not_a_mistake() -> None:
    course = solo(SANDWICH)
    assert evidence(with_rejected(course, "Pick up cheese1 at table1 with robot1"))
    free = refused(course, 0, "Pick up cheese1 at table1 with robot1")[0]
    turn = replace(free, unmet=(), reasons=("it is robot2's turn",))
    assert evidence(replace(course, answers=(turn,))) == []
