"""Any model that Inspect has a provider for: Anthropic, Google, Hugging Face, vLLM, …"""

from __future__ import annotations

import hashlib
import os
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING

from robotouille.errors import MissingExtraError
from robotouille_evaluation.models.answers import Answer, encodable, read_completion
from robotouille_evaluation.models.failures import refusal, secrets_in, shown
from robotouille_evaluation.models.model import (
    Completion,
    Message,
    ModelError,
    ModelErrorKind,
    ModelRequest,
)
from robotouille_evaluation.models.retries import RetryPolicy

if TYPE_CHECKING:
    from inspect_ai.model import ChatMessage, GenerateConfig, ModelOutput
    from inspect_ai.model import Model as Provider

__all__ = ["InspectModel", "as_chat", "open_inspect_model"]

ATTEMPT_TIMEOUT = 120
"""Seconds, where the model is opened here."""
MARKUP = re.compile(r"\[/?[a-z]+\]")
"""Bold and the like in Inspect's own errors."""


class InspectModel:
    """Asks through a provider of Inspect, whose settings, retries and limits hold.

    Args:
        provider: What `inspect_ai.model.get_model` returns. Use as `async with` to close it.
    """

    def __init__(self, provider: Provider) -> None:
        self.name = str(provider)
        self._provider = provider

    async def __aenter__(self) -> InspectModel:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self._provider.__aexit__(kind, error, trace)

    async def complete(self, request: ModelRequest) -> Completion:
        """The model's answer.

        Raises:
            ModelError: There is none. What the provider raised is its cause.
            LimitExceededError: Inspect's, where a limit of a sample is used up.
        """
        from inspect_ai.util import LimitExceededError

        config = _config(request.parameters)
        try:
            output = await self._provider.generate(as_chat(request.messages), config=config)
        except LimitExceededError:
            raise
        except Exception as error:  # Each provider has its own.
            raise _failed(error) from error
        answer = _read(output)
        return Completion(answer.text, answer.usage, output.time or 0.0, answer.finish_reason)


def open_inspect_model(
    name: str, base_url: str = "", parameters: Mapping[str, object] | None = None
) -> InspectModel:
    """A model by Inspect's name for it: `anthropic/claude-…`. Keys come from the environment.

    Args:
        parameters: Settings of Inspect's `GenerateConfig`, for all requests.

    Raises:
        MissingExtraError: Inspect is not installed.
        ModelError: There is no such provider or setting, it is not installed, or has no key.
    """
    try:
        from inspect_ai.model import get_model
    except ImportError:
        raise MissingExtraError("a model of Inspect's providers", "bench") from None
    limits = {"max_retries": RetryPolicy().attempts - 1, "attempt_timeout": ATTEMPT_TIMEOUT}
    config = _config({**limits, **(parameters or {})})
    try:
        return InspectModel(
            get_model(name, config=config, base_url=base_url or None, memoize=False)
        )
    except Exception as error:  # Each provider has its own.
        raise _failed(error) from error


def as_chat(messages: tuple[Message, ...]) -> list[ChatMessage]:
    """A conversation as Inspect has it.

    A message has the same id wherever the same is said in its place: what hundreds of requests
    have in common is then in a log only once.
    """
    from inspect_ai.model import ChatMessageAssistant, ChatMessageSystem, ChatMessageUser

    kinds = {
        "system": ChatMessageSystem,
        "user": ChatMessageUser,
        "assistant": ChatMessageAssistant,
    }
    seen: Counter[Message] = Counter()
    chat: list[ChatMessage] = []
    for message in messages:
        seen[message] += 1
        said = f"{message.role}\0{seen[message]}\0{message.content}"
        id_ = hashlib.sha256(said.encode(errors="replace")).hexdigest()[:22]
        chat.append(kinds[message.role](content=encodable(message.content), id=id_))
    return chat


def _config(parameters: Mapping[str, object]) -> GenerateConfig:
    from inspect_ai.model import GenerateConfig
    from pydantic import ValidationError

    unknown = parameters.keys() - GenerateConfig.model_fields.keys()
    if unknown:
        raise ModelError(ModelErrorKind.REFUSED, f"Inspect has no setting {min(unknown)!r}")
    try:
        return GenerateConfig.model_validate(dict(parameters))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        setting = ".".join(map(str, first["loc"]))
        raise ModelError(ModelErrorKind.REFUSED, f"{setting}: {first['msg']}") from None


def _read(output: ModelOutput) -> Answer:
    """The answer in what a provider returned, with the same care as an endpoint's."""
    used = output.usage
    sent = received = 0
    if used is not None:
        cached = (used.input_tokens_cache_read or 0) + (used.input_tokens_cache_write or 0)
        sent, received = used.input_tokens + cached, used.output_tokens
    choice = output.choices[0] if output.choices else None
    reason = choice.stop_reason if choice is not None else "unknown"
    if reason == "model_length" and not received:  # Refused, with the provider's words as text.
        said = shown(output.completion, *secrets_in(os.environ))
        raise ModelError(ModelErrorKind.CONTEXT_OVERFLOW, said or "the conversation is too long")
    message = {
        "content": output.completion,
        "tool_calls": bool(choice is not None and choice.message.tool_calls),
        "refusal": output.error,
    }
    answer = read_completion(
        {
            "choices": [{"message": message, "finish_reason": reason}],
            "usage": {"prompt_tokens": sent, "completion_tokens": received},
        },
        secrets=secrets_in(os.environ),
    )
    cost = used.total_cost if used is not None else None
    return replace(answer, usage=replace(answer.usage, cost=cost))


def _failed(error: Exception) -> ModelError:
    """A provider's exception in our words, without keys: which one it was sent is not known here,
    so none that the environment has may be in them."""
    said = getattr(error, "message", None) or error
    words = " ".join(MARKUP.sub("", str(said)).split()) or type(error).__name__
    words = shown(words, *secrets_in(os.environ))
    status = getattr(error, "status_code", None)
    if isinstance(status, int) and status >= 300:
        return refusal(status, {}, words, "", 0.0)
    return ModelError(ModelErrorKind.ENDPOINT, words)
