"""Grammars of valid actions, and where the actions come from."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

import robotouille
from robotouille.errors import WrongArgumentError
from robotouille_evaluation.models.grammar import action_grammar, literal
from robotouille_evaluation.models.model import Message, ModelRequest
from robotouille_evaluation.models.valid_actions import valid_actions


def test_a_grammar() -> None:
    assert action_grammar(["Wait", 'Say "a\\b"', "Wait"]) == (
        'root ::= "Action: " action\naction ::= "Wait" | "Say \\"a\\\\b\\""\n'
    )
    assert action_grammar(["Wait"], reasoning=60).startswith(
        'root ::= "Reasoning: " [^\\n]{1,60} "\\n" "Action: " action\n'
    )
    with pytest.raises(WrongArgumentError):
        action_grammar([])


def spoken(text: str) -> str:
    """What a literal stands for, as llama.cpp reads it."""
    pattern = r"\\(x[0-9A-F]{2}|U[0-9A-F]{8}|.)"
    return re.sub(
        pattern, lambda m: m[1] if len(m[1]) == 1 else chr(int(m[1][1:], 16)), text[1:-1]
    )


@given(st.text())
def test_literals_say_what_they_stand_for(text: str) -> None:
    written = literal(text)
    assert "\n" not in written and spoken(written) == text
    assert not re.search(r'(?<!\\)(?:\\\\)*"', written[1:-1])


def asked(*contents: str) -> ModelRequest:
    return ModelRequest(tuple(Message("user", content) for content in contents))


def test_the_actions_of_an_observation() -> None:
    world = robotouille.World("synchronous/01")
    text = world.initial.text("robot1")
    sentences = tuple(action.sentence for action in world.initial.actions("robot1"))
    assert valid_actions(asked("What to do: Valid Actions: ...", text)) == sentences
    assert valid_actions(asked(text, "Error Feedback: no")) == sentences


def test_layouts_of_observations() -> None:
    assert valid_actions(asked("Valid Actions:\nA\nB\nGoal: C\nD")) == ("A", "B")
    assert valid_actions(asked("Valid Actions:\n\nA\nB\n\nC")) == ("A", "B")
    assert valid_actions(asked("Valid Actions:\nA\n\nValid Actions:\nB")) == ("B",)
    assert valid_actions(asked("Valid Actions:\n\nGoal: C\nD")) == ()
    assert valid_actions(asked("Reflect on it")) == ()
    assert valid_actions(ModelRequest((Message("assistant", "Valid Actions:\nA"),))) == ()
