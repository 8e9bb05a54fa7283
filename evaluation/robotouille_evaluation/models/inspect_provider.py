"""Models of Inspect's providers, such as Anthropic, Google, Hugging Face and vLLM."""

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
from robotouille_evaluation.models.model import (
    Completion,
    Message,
    ModelError,
    ModelErrorKind,
    ModelRequest,
)
from robotouille_evaluation.models.responses import (
    ModelAnswer,
    encodable,
    error_of_status,
    excerpt,
    read_completion,
    secrets_in,
)

if TYPE_CHECKING:
    from inspect_ai.model import ChatMessage, GenerateConfig, ModelOutput
    from inspect_ai.model import Model as Provider

MAX_RETRIES = 5
ATTEMPT_TIMEOUT = 120
"""Seconds, for models that are opened here."""
MARKUP = re.compile(r"\[/?[a-z]+\]")
"""Markup such as `[bold]` in Inspect's own errors."""


class InspectModel:
    """Model of an Inspect provider, with the provider's settings, retries and limits.

    Use it as `async with` to close it.

    Args:
        provider: Result of `inspect_ai.model.get_model`.
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
        """Return the model's answer.

        Raises:
            ModelError: The provider failed; its exception is the cause.
            LimitExceededError: A limit of an Inspect sample is used up.
        """
        from inspect_ai.util import LimitExceededError

        config = _config(request.parameters)
        try:
            output = await self._provider.generate(as_chat(request.messages), config=config)
        except LimitExceededError:
            raise
        except Exception as error:  # Each provider raises exceptions of its own SDK.
            raise _model_error(error) from error
        answer = _read(output)
        return Completion(answer.text, answer.usage, output.time or 0.0, answer.finish_reason)


def open_inspect_model(
    name: str, base_url: str = "", parameters: Mapping[str, object] | None = None
) -> InspectModel:
    """Open a model by Inspect's name for it, such as `anthropic/claude-…`.

    Keys come from the environment.

    Args:
        parameters: Settings of Inspect's `GenerateConfig`, for all requests.

    Raises:
        MissingExtraError: Inspect is not installed.
        ModelError: The provider or a setting is unknown, or the provider is not installed or has
            no key.
    """
    try:
        from inspect_ai.model import get_model
    except ImportError:
        raise MissingExtraError("a model of Inspect's providers", "bench") from None
    limits = {"max_retries": MAX_RETRIES, "attempt_timeout": ATTEMPT_TIMEOUT}
    config = _config({**limits, **(parameters or {})})
    try:
        return InspectModel(
            # memoize=False: a memoized model could already be closed.
            get_model(name, config=config, base_url=base_url or None, memoize=False)
        )
    except Exception as error:  # Each provider raises exceptions of its own SDK.
        raise _model_error(error) from error


def as_chat(messages: tuple[Message, ...]) -> list[ChatMessage]:
    """Return a conversation as Inspect's messages.

    Equal messages at the same place in two conversations have the same id. Inspect's logs
    therefore store what hundreds of requests have in common only once.
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
        content = f"{message.role}\0{seen[message]}\0{message.content}"
        id_ = hashlib.sha256(content.encode(errors="replace")).hexdigest()[:22]
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


def _read(output: ModelOutput) -> ModelAnswer:
    used = output.usage
    sent = received = 0
    if used is not None:
        cached = (used.input_tokens_cache_read or 0) + (used.input_tokens_cache_write or 0)
        sent, received = used.input_tokens + cached, used.output_tokens
    choice = output.choices[0] if output.choices else None
    reason = choice.stop_reason if choice is not None else "unknown"
    if reason == "model_length" and not received:
        # Inspect reports a refused request as an output whose text is the provider's message.
        detail = excerpt(output.completion, *secrets_in(os.environ))
        raise ModelError(ModelErrorKind.CONTEXT_OVERFLOW, detail or "the conversation is too long")
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


def _model_error(error: Exception) -> ModelError:
    """Return the `ModelError` for a provider's exception.

    The provider does not say which key it sent, so all keys of the environment are removed.
    """
    message = getattr(error, "message", None) or error
    words = " ".join(MARKUP.sub("", str(message)).split()) or type(error).__name__
    words = excerpt(words, *secrets_in(os.environ))
    status = getattr(error, "status_code", None)
    if isinstance(status, int) and status >= 300:
        return error_of_status(status, words, "")
    return ModelError(ModelErrorKind.ENDPOINT, words)
