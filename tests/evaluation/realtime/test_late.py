"""Late answers, and the digest of what has changed."""

from __future__ import annotations

import pytest

from robotouille import State, World, load_task
from robotouille_evaluation.realtime import Late, Look, digest, estimated_tokens, holds

WORLD = World(load_task("multi_agent/01"))
"""robot1 stands at table2, where the lower half of the bun is; robot2 at table1."""
STOVE, TABLE7 = "Move robot1 from table2 to stove1", "Move robot1 from table2 to table7"


def look(state: State, step: int) -> Look:
    valid = tuple(action.sentence for action in state.actions("robot1"))
    return Look(step, state.text_view("robot1"), valid)


THEN = look(WORLD.initial, 3)
ELSEWHERE = look(WORLD.initial.step("Move robot2 from table1 to table7").state, 4)
IN_THE_WAY = look(WORLD.initial.step("Move robot2 from table1 to stove1").state, 4)


@pytest.mark.parametrize(
    ("late", "now", "action", "wanted"),
    [
        (Late.APPLY, IN_THE_WAY, STOVE, True),
        (Late.REVALIDATE, IN_THE_WAY, STOVE, False),
        (Late.REVALIDATE, ELSEWHERE, STOVE, True),
        (Late.REVALIDATE, ELSEWHERE, TABLE7, False),
        (Late.REVALIDATE, ELSEWHERE, "Do nothing", True),
        (Late.DROP, ELSEWHERE, STOVE, False),
        (Late.DROP, look(WORLD.initial, 9), STOVE, True),
        (Late.DROP, look(IN_THE_WAY and WORLD.initial, 3), STOVE, True),
    ],
)
def test_which_answers_are_acted_upon(late: Late, now: Look, action: str, wanted: bool) -> None:
    assert holds(late, action, THEN, now) is wanted


def test_what_is_named_may_be_as_it_was_and_the_action_invalid() -> None:
    """The same lines, and the action is not in the list: somebody's hand came first."""
    now = Look(5, THEN.text, ("Do nothing",))
    assert not holds(Late.REVALIDATE, STOVE, THEN, now)


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


def test_the_digest_says_who_did_what_and_which_lines_came_and_went() -> None:
    assert digest(THEN.text, IN_THE_WAY.text, 1, DEEDS, 1000) == WHOLE


@pytest.mark.parametrize("tokens", range(0, 90))
def test_the_digest_keeps_to_its_budget_and_counts_what_it_leaves_out(tokens: int) -> None:
    text = digest(THEN.text, IN_THE_WAY.text, 1, DEEDS, tokens)
    assert estimated_tokens(text) <= tokens
    shown = text.splitlines()
    if not shown:
        return
    if text != WHOLE:
        left = len(WHOLE.splitlines()) - (len(shown) - 1)
        assert shown.pop() == f"({left} more lines are left out.)"
    assert shown == WHOLE.splitlines()[: len(shown)]


def test_four_characters_are_a_token() -> None:
    assert [estimated_tokens("x" * n) for n in (0, 1, 4, 5)] == [0, 1, 1, 2]
