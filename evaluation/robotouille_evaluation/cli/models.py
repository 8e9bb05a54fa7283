"""Language models that command-line options name."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field, replace
from urllib.parse import urlsplit

from robotouille.errors import RobotouilleError
from robotouille_client.bots.llm_options import ModelOptions
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

MOCK = "mock"
"""Model with seeded answers, most of them valid, for trying things out."""
LOCAL = "local"
"""Small model in this process, whose answers are valid actions."""
INSPECT = "inspect:"
"""Prefix of models that an Inspect provider asks."""
FATAL = (ModelErrorKind.NO_KEY, ModelErrorKind.REFUSED, ModelErrorKind.ENDPOINT)
"""Errors that every further request would meet as well."""
LOOPBACK = frozenset({"127.0.0.1", "::1", "localhost"})


@dataclass(frozen=True, slots=True)
class ModelChoice:
    """Model and the way it is asked.

    Args:
        name: `mock`, `local`, `inspect:PROVIDER/MODEL`, or the model's name at an endpoint.
        base_url: Address of the endpoint; OpenAI's if empty.
        parameters: Parameters of each request.
        prices: Prices of a million tokens sent and received (`0.40/1.20`); list prices if empty.
        timeout: Seconds for an attempt; the endpoint's default if None.
        attempts: Most requests for one answer; the endpoint's default if None.

    Raises:
        WrongArgumentError: The prices are invalid.
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
    def of_options(cls, options: ModelOptions) -> ModelChoice:
        """Return the model of a command's options."""
        temperature = options.temperature
        return cls(
            options.model,
            options.base_url,
            {} if temperature is None else {"temperature": temperature},
            options.price,
            options.timeout,
            options.attempts,
        )

    @classmethod
    def of_agent(cls, agent: AgentSpec) -> ModelChoice:
        """Return the model of a run's agent."""
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
        """True if no key is sent to an address that another person may have chosen."""
        if self.name in (MOCK, LOCAL):
            return True
        if self.name.startswith(INSPECT):
            return not self.base_url
        url = self.endpoint().base_url
        return url == OPENAI_URL or (
            urlsplit(url).hostname in LOOPBACK and key_from_environment(os.environ, url) is None
        )

    def endpoint(self) -> Endpoint:
        """Return the endpoint, or raise WrongArgumentError if its address is invalid."""
        endpoint = Endpoint(self.name, self.base_url or OPENAI_URL, self.parameters)
        if self.prices:
            endpoint = replace(endpoint, prices=Prices.parse(self.prices))
        if self.timeout is not None:
            endpoint = replace(endpoint, timeout=self.timeout)
        if self.attempts is not None:
            endpoint = replace(endpoint, attempts=self.attempts)
        return endpoint


def require_base_url(choices: Iterable[ModelChoice], given: str) -> None:
    """Require that the user confirms the endpoints that a run's file names.

    Runs can come from other people, and their file could send the user's key anywhere.

    Args:
        given: Base URL that the user has typed.

    Raises:
        RobotouilleError: A key would be sent to another address.
    """
    for choice in choices:
        if choice.base_url != given and not choice.is_sent_no_secret:
            key = "your provider's key" if choice.name.startswith(INSPECT) else KEY_VARIABLES[0]
            raise RobotouilleError(
                f"the run asks {choice.name} at {choice.base_url} and would send it {key}; "
                f"if you trust it, add --base-url {choice.base_url}"
            )


async def check_model(choice: ModelChoice) -> None:
    """Check what can be checked before a model is asked.

    Raises:
        WrongArgumentError: The address is invalid.
        ModelError: The key is missing, or the provider is unknown.
    """
    if choice.name.startswith(INSPECT):
        async with AsyncExitStack() as opened:
            await open_model(choice, 0, opened)
    elif choice.name not in (MOCK, LOCAL):
        key_of(choice.endpoint())


async def open_model(choice: ModelChoice, seed: int, opened: AsyncExitStack) -> Model:
    """Open a model until `opened` is closed.

    Args:
        seed: Seed of models in this process.

    Raises:
        MissingExtraError: The model needs an extra that is not installed.
        ModelError: The key is missing, or the provider is unknown.
    """
    if choice.name == MOCK:
        return ScriptedModel(SeededAnswers(seed), MOCK)
    if choice.name == LOCAL:
        from robotouille_evaluation.models.local import LocalModel

        # The given parameters may override the seed.
        parameters = {"seed": seed, **choice.parameters}
        return opened.enter_context(LocalModel(parameters=parameters))
    if choice.name.startswith(INSPECT):
        wanted = choice.name.removeprefix(INSPECT)
        provider = open_inspect_model(wanted, choice.base_url, choice.parameters)
        return await opened.enter_async_context(provider)
    return await opened.enter_async_context(OpenAICompatibleModel(choice.endpoint()))
