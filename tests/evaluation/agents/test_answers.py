"""Answers taken apart: as published, letter by letter; tolerantly, as a person would read them."""

from __future__ import annotations

import pytest

from robotouille_evaluation.agents import ParsedAnswer, Published, Tolerant

VALID = ("Move robot1 from table1 to table2", "Pick up bread1 at table1 with robot1", "Do nothing")
MOVE = VALID[0]


@pytest.mark.parametrize(
    ("text", "reasoning", "action"),
    [
        (f"Reasoning: so.\n\nAction: {MOVE}", "so.\n\n", MOVE),
        (f"Reasoning:\nAction: {MOVE}", "\n", MOVE),
        (f"Action: {MOVE}", None, MOVE),
        (f"**Reasoning:** so.\nAction: {MOVE}", None, MOVE),
        (f"Reasoning: so. Action: {MOVE}", "so. ", None),
        ("Reasoning: Action: a\nAction: b\nAction: c", "Action: a\nAction: b\n", "b"),
        (f"Reasoning: so\r\nAction:  {MOVE} \r\n", "so\r\n", MOVE),
        ("Reasoning: so\nAction:\n\nMove", "so\n", "Move"),
        ("Reasoning: so\nAction:", "so\n", None),
        ("", None, None),
    ],
)
def test_published(text: str, reasoning: str | None, action: str | None) -> None:
    assert Published().step(text) == ParsedAnswer(reasoning, action)


def test_published_plans_keep_their_empty_lines() -> None:
    assert Published().plan("Sure!\nPlan: a\n b \n\nc\n") == ("a", "b", "", "c", "")
    assert Published().plan("A Plan: a") == ()
    assert Published().steps("Action: a\nThen: x\n1. Action: b\nAction: c ") == ("a", "c")


@pytest.mark.parametrize(
    "text",
    [
        f"Reasoning: so\nAction: {MOVE}",
        f"**Reasoning:** so\n\n**Action:** {MOVE}.",
        f"## Reasoning: so\n## Action: `{MOVE}`",
        f"reasoning: so\nACTION: {MOVE.upper()}",
        f"Thought: so\n2. Action: [{MOVE}]",
        f"Reasoning: so\nAction: Do nothing\nNo, rather:\nAction: {MOVE}",
        f'Reasoning: so\nAction:\n "{MOVE}"\n',
    ],
)
def test_tolerant(text: str) -> None:
    parser = Tolerant()
    answer = parser.step(text)
    assert answer.action is not None
    assert parser.match(answer.action, VALID) == MOVE
    assert (answer.reasoning or "").startswith("so")


@pytest.mark.parametrize(
    "text", ["", "I cannot do that.", "移动到桌子", "The next action is clear."]
)
def test_no_action_is_none(text: str) -> None:
    assert Tolerant().step(text).action is None


@pytest.mark.parametrize(
    "action", ["Move robot1", "Fly to table2", "", "Move robot1 from table2 to table1"]
)
def test_what_is_not_valid_stays_so(action: str) -> None:
    assert Tolerant().match(action, VALID) is None


def test_tolerant_plans() -> None:
    text = "Plan:\n1. a\n\n2) b.\n- c\n"
    assert Tolerant().plan(text) == ("a", "b", "c")
    assert Tolerant().steps("1. **Action:** a\nThen: x\nAction 2: b") == ("a", "b")


def test_an_answer_of_a_megabyte_takes_no_time() -> None:
    """No expression backtracks: a second for each of these would be a minute in all."""
    for text in ("Reasoning: " * 100_000, "Action" * 150_000, "#" * 1_000_000, "\n" * 1_000_000):
        Tolerant().step(text)
        Tolerant().plan(text)
        Tolerant().steps(text)
        Published().step(text)
