"""Language models by their names on a command line."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field, replace

from robotouille_evaluation.models import (
    Endpoint,
    Model,
    OpenAICompatibleModel,
    Prices,
    ScriptedModel,
    SeededAnswers,
    open_inspect_model,
)
from robotouille_evaluation.models.openai_compatible import OPENAI_URL

__all__ = ["INSPECT", "LOCAL", "MOCK", "ModelChoice", "open_model"]

MOCK = "mock"
"""Answers by a seed, mostly well: for trying things out."""
LOCAL = "local"
"""A small model in this process, whose answers are valid actions."""
INSPECT = "inspect:"
"""Before the name of a model that one of Inspect's providers asks."""


@dataclass(frozen=True, slots=True)
class ModelChoice:
    """A model and how it is asked.

    Args:
        name: `mock`, `local`, `inspect:PROVIDER/MODEL`, or what an endpoint calls it.
        base_url: Of the endpoint; OpenAI's if empty.
        parameters: Sent with each request.
        prices: Of a million tokens sent and received (`0.40/1.20`); unknown if empty.
        timeout: Seconds for an attempt; the usual ones if None.
        attempts: How often the endpoint is asked at most; the usual number if None.

    Raises:
        WrongArgumentError: The prices are none.
    """

    name: str
    base_url: str = ""
    parameters: Mapping[str, object] = field(default_factory=dict)
    prices: str = ""
    timeout: float | None = None
    attempts: int | None = None

    def __post_init__(self) -> None:
        if self.prices:
            Prices.parse(self.prices)

    def endpoint(self) -> Endpoint:
        """Where it is; WrongArgumentError if that cannot be."""
        asked = Endpoint(self.name, self.base_url or OPENAI_URL, self.parameters)
        if self.prices:
            asked = replace(asked, prices=Prices.parse(self.prices))
        if self.timeout is not None:
            asked = replace(asked, timeout=self.timeout)
        if self.attempts is not None:
            asked = replace(asked, retries=replace(asked.retries, attempts=self.attempts))
        return asked


async def open_model(choice: ModelChoice, seed: int, opened: AsyncExitStack) -> Model:
    """A model, until `opened` is closed.

    Args:
        seed: Of what is drawn in this process.

    Raises:
        MissingExtraError: What it takes is not installed.
        ModelError: There is no key, or no such provider.
    """
    if choice.name == MOCK:
        return ScriptedModel(SeededAnswers(seed), MOCK)
    if choice.name == LOCAL:
        from robotouille_evaluation.models.local import LocalModel

        parameters = {"seed": seed, **choice.parameters}
        return opened.enter_context(LocalModel(parameters=parameters))
    if choice.name.startswith(INSPECT):
        wanted = choice.name.removeprefix(INSPECT)
        provider = open_inspect_model(wanted, choice.base_url, choice.parameters)
        return await opened.enter_async_context(provider)
    return await opened.enter_async_context(OpenAICompatibleModel(choice.endpoint()))
