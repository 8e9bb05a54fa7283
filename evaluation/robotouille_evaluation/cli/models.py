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
    open_inspect_model,
)
from robotouille_evaluation.models.openai_compatible import OPENAI_URL

__all__ = ["INSPECT", "LOCAL", "MOCK", "open_model"]

MOCK = "mock"
"""Answers by a seed, mostly well: for trying things out."""
LOCAL = "local"
"""A small model in this process, whose answers are valid actions."""
INSPECT = "inspect:"
"""Before the name of a model that one of Inspect's providers asks."""


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
        ModelError: There is no key, or no such provider.
    """
    if name == MOCK:
        return ScriptedModel(SeededAnswers(seed), MOCK)
    if name == LOCAL:
        from robotouille_evaluation.models.local import LocalModel

        return opened.enter_context(LocalModel())
    if name.startswith(INSPECT):
        provider = open_inspect_model(name.removeprefix(INSPECT), base_url, parameters)
        return await opened.enter_async_context(provider)
    endpoint = Endpoint(name, base_url or OPENAI_URL, parameters)
    return await opened.enter_async_context(OpenAICompatibleModel(endpoint))
