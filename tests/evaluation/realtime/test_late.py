"""Rules for late answers, and the digest of changes."""

from __future__ import annotations

import pytest

from robotouille import State, World, load_task
from robotouille_evaluation.realtime import (
    LatePolicy,
    ObservedStep,
    digest,
    estimated_tokens,
    still_holds,
)

WORLD = World(load_task("multi_agent/01"))
"""robot1 stands at table2 with the bottom bun, robot2 at table1."""
STOVE, TABLE7 = "Move robot1 from table2 to stove1", "Move robot1 from table2 to table7"


def look(state: State, step: int) -> ObservedStep:
    valid = tuple(action.sentence for action in state.actions("robot1"))
    return ObservedStep(step, state.text_view("robot1"), valid)


THEN = look(WORLD.initial, 3)
ELSEWHERE = look(WORLD.initial.step("Move robot2 from table1 to table7").state, 4)
IN_THE_WAY = look(WORLD.initial.step("Move robot2 from table1 to stove1").state, 4)


@pytest.mark.parametrize(
    ("late", "now", "action", "wanted"),
    [
        (LatePolicy.APPLY, IN_THE_WAY, STOVE, True),
        (LatePolicy.REVALIDATE, IN_THE_WAY, STOVE, False),
        (LatePolicy.REVALIDATE, ELSEWHERE, STOVE, True),
        (LatePolicy.REVALIDATE, ELSEWHERE, TABLE7, False),
        (LatePolicy.REVALIDATE, ELSEWHERE, "Do nothing", True),
        (LatePolicy.DROP, ELSEWHERE, STOVE, False),
        (LatePolicy.DROP, look(WORLD.initial, 9), STOVE, True),
        (LatePolicy.DROP, look(IN_THE_WAY and WORLD.initial, 3), STOVE, True),
    ],
)
def test_rules_for_late_answers(
    late: LatePolicy, now: ObservedStep, action: str, wanted: bool
) -> None:
    assert still_holds(late, action, THEN, now) is wanted


def test_invalid_action_with_unchanged_objects() -> None:
    """The observation is equal, but another player was first."""
    now = ObservedStep(5, THEN.text, ("Do nothing",))
    assert not still_holds(LatePolicy.REVALIDATE, STOVE, THEN, now)


WHOLE = """\
Since you last looked 1 step has passed.
* robot2: Move robot2 from table1 to stove1
* you: Do nothing
+ table1 has nobody standing at it
+ stove1 has robot2 standing at it
+ robot2 stands at stove1
- table1 has robot2 standing at it
- stove1 has nobody standing at it
- robot2 stands at table1"""
DEEDS = ["you: Do nothing", "robot2: Move robot2 from table1 to stove1"]


def test_digest_lists_actions_and_changed_lines() -> None:
    assert digest(THEN.text, IN_THE_WAY.text, 1, DEEDS, 1000) == WHOLE


def test_digest_counts_omitted_lines() -> None:
    whole = WHOLE.splitlines()
    for tokens in range(90):
        text = digest(THEN.text, IN_THE_WAY.text, 1, DEEDS, tokens)
        assert estimated_tokens(text) <= tokens
        shown = text.splitlines()
        if shown and text != WHOLE:
            left = len(whole) - (len(shown) - 1)
            assert shown.pop() == f"({left} more lines are left out.)"
        assert shown == whole[: len(shown)]


def test_estimated_tokens() -> None:
    assert [estimated_tokens("x" * n) for n in (0, 1, 4, 5)] == [0, 1, 1, 2]
