"""Late answers, and the charge for thinking."""

from __future__ import annotations

import pytest

from robotouille import State, World, load_task
from robotouille.errors import WrongArgumentError
from robotouille_evaluation.agents import Exchange, ExchangeVerdict
from robotouille_evaluation.models import Completion, ModelRequest, Usage
from robotouille_evaluation.realtime import (
    Charge,
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


def exchange(text: str = "", tokens: int = 0, seconds: float = 0.0) -> Exchange:
    answer = Completion(text, Usage(1000, tokens), seconds)
    return Exchange(ModelRequest(()), answer, ExchangeVerdict.ACTION)


UNANSWERED = Exchange(ModelRequest(()), None, ExchangeVerdict.OVERFLOW)


@pytest.mark.parametrize(
    ("charge", "ms"),
    [("wall", 3500), ("tokens:20", 2100), ("tokens:0.1", 11), ("declared:1500", 3000)],
)  # fmt: skip
def test_all_calls_of_a_proposal_are_charged(charge: str, ms: int) -> None:
    """100 tokens in 3 s, and 18 characters without a count in half a second."""
    calls = [exchange("x", 100, 3.0), UNANSWERED, exchange("a text of 18 signs", 0, 0.5)]
    assert Charge.parse(charge).milliseconds(calls) == ms
    assert str(Charge.parse(charge)) == charge


def test_charge_is_at_most_a_day() -> None:
    assert Charge.parse("tokens:86400000").milliseconds([exchange("x", 10)]) == 86_400_000


@pytest.mark.parametrize(
    "text", ["", "tokens", "tokens:", "tokens:-1", "tokens:nan", "declared:inf", "wall:3", "x:1"]
)
def test_invalid_charges_are_refused(text: str) -> None:
    with pytest.raises(WrongArgumentError, match="tokens:MILLISECONDS"):
        Charge.parse(text)
