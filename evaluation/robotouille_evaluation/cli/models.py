"""Language models by their names on a command line."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AsyncExitStack

from robotouille_evaluation.models import (
    Endpoint,
    Model,
    OpenAICompatibleModel,
    ScriptedModel,
    SeededAnswers,
)
from robotouille_evaluation.models.openai_compatible import OPENAI_URL

__all__ = ["LOCAL", "MOCK", "open_model"]

MOCK = "mock"
"""Answers by a seed, mostly well: for trying things out."""
LOCAL = "local"
"""A small model in this process, whose answers are valid actions."""


async def open_model(
    name: str,
    base_url: str,
    parameters: Mapping[str, object],
    seed: int,
    opened: AsyncExitStack,
) -> Model:
    """A model, until `opened` is closed.

    Raises:
        MissingExtraError: What it takes is not installed.
        ModelError: There is no key.
    """
    if name == MOCK:
        return ScriptedModel(SeededAnswers(seed), MOCK)
    if name == LOCAL:
        from robotouille_evaluation.models.local import LocalModel

        return opened.enter_context(LocalModel(parameters={"seed": seed, **parameters}))
    endpoint = Endpoint(name, base_url or OPENAI_URL, parameters)
    return await opened.enter_async_context(OpenAICompatibleModel(endpoint))
