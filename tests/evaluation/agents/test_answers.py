"""Parsers of answers: the published one and the tolerant one."""

from __future__ import annotations

import pytest

from robotouille_evaluation.agents import ParsedAnswer, PublishedParser, TolerantParser

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
def test_published_parser(text: str, reasoning: str | None, action: str | None) -> None:
    assert PublishedParser().step(text) == ParsedAnswer(reasoning, action)


def test_published_plans_keep_empty_lines() -> None:
    assert PublishedParser().plan("Sure!\nPlan: a\n b \n\nc\n") == ("a", "b", "", "c", "")
    assert PublishedParser().plan("A Plan: a") == ()
    assert PublishedParser().steps("Action: a\nThen: x\n1. Action: b\nAction: c ") == ("a", "c")


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
def test_tolerant_parser(text: str) -> None:
    parser = TolerantParser()
    answer = parser.step(text)
    assert answer.action is not None
    assert parser.match(answer.action, VALID) == MOVE
    assert (answer.reasoning or "").startswith("so")


@pytest.mark.parametrize(
    "text", ["", "I cannot do that.", "移动到桌子", "The next action is clear."]
)
def test_answers_without_action(text: str) -> None:
    assert TolerantParser().step(text).action is None


@pytest.mark.parametrize(
    "action", ["Move robot1", "Fly to table2", "", "Move robot1 from table2 to table1"]
)
def test_invalid_actions_stay_invalid(action: str) -> None:
    assert TolerantParser().match(action, VALID) is None


def test_tolerant_plans_skip_empty_lines() -> None:
    text = "Plan:\n1. a\n\n2) b.\n- c\n"
    assert TolerantParser().plan(text) == ("a", "b", "c")
    assert TolerantParser().steps("1. **Action:** a\nThen: x\nAction 2: b") == ("a", "b")


def test_long_answers_are_parsed_quickly() -> None:
    """No pattern backtracks: a second for each of these would be a minute in all."""
    for text in ("Reasoning: " * 100_000, "Action" * 150_000, "#" * 1_000_000, "\n" * 1_000_000):
        TolerantParser().step(text)
        TolerantParser().plan(text)
        TolerantParser().steps(text)
        PublishedParser().step(text)
