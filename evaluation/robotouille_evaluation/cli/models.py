"""Language models by their names on a command line."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field, replace
from urllib.parse import urlsplit

from robotouille.errors import RobotouilleError
from robotouille_evaluation.models import (
    Endpoint,
    Model,
    ModelErrorKind,
    OpenAICompatibleModel,
    Prices,
    ScriptedModel,
    SeededAnswers,
    open_inspect_model,
)
from robotouille_evaluation.models.openai_compatible import (
    KEY_VARIABLES,
    OPENAI_URL,
    key_from_environment,
    key_of,
)
from robotouille_evaluation.runs import AgentSpec

__all__ = [
    "FATAL",
    "INSPECT",
    "LOCAL",
    "MOCK",
    "ModelChoice",
    "check_model",
    "open_model",
    "require_base_url",
]

MOCK = "mock"
"""Answers by a seed, mostly well: for trying things out."""
LOCAL = "local"
"""A small model in this process, whose answers are valid actions."""
INSPECT = "inspect:"
"""Before the name of a model that one of Inspect's providers asks."""
FATAL = (ModelErrorKind.NO_KEY, ModelErrorKind.REFUSED, ModelErrorKind.ENDPOINT)
"""Errors after which asking something else is of no use."""
LOOPBACK = frozenset({"127.0.0.1", "::1", "localhost"})


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

    @classmethod
    def of(cls, agent: AgentSpec) -> ModelChoice:
        """The model of an agent of a run."""
        return cls(
            agent.model,
            agent.base_url,
            agent.parameters,
            agent.prices,
            agent.timeout,
            agent.attempts,
        )

    @property
    def is_sent_no_secret(self) -> bool:
        """Whether no key goes to an address that somebody else may have written down."""
        if self.name in (MOCK, LOCAL):
            return True
        if self.name.startswith(INSPECT):
            return not self.base_url
        url = self.endpoint().base_url
        return url == OPENAI_URL or (
            urlsplit(url).hostname in LOOPBACK and key_from_environment(os.environ, url) is None
        )

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


def require_base_url(choices: Iterable[ModelChoice], given: str) -> None:
    """Models that a file names are asked only where whoever goes on with it means them to be.

    Args:
        given: The base URL that was named again.

    Raises:
        RobotouilleError: A key would be sent to another.
    """
    for choice in choices:
        if choice.base_url != given and not choice.is_sent_no_secret:
            key = "your provider's key" if choice.name.startswith(INSPECT) else KEY_VARIABLES[0]
            raise RobotouilleError(
                f"the run asks {choice.name} at {choice.base_url}, which would be sent {key}, "
                f"if it is set; if you mean that, say --base-url {choice.base_url}"
            )


async def check_model(choice: ModelChoice) -> None:
    """Find out what can be found out before a model is asked.

    Raises:
        WrongArgumentError: Its address cannot be.
        ModelError: There is no key, or no such provider.
    """
    if choice.name.startswith(INSPECT):
        async with AsyncExitStack() as opened:
            await open_model(choice, 0, opened)
    elif choice.name not in (MOCK, LOCAL):
        key_of(choice.endpoint())


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
