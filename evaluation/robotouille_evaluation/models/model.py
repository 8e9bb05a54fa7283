"""What a language model is asked and answers, and why it has not answered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from robotouille.errors import RobotouilleError

__all__ = [
    "Completion",
    "Message",
    "Model",
    "ModelError",
    "ModelErrorKind",
    "ModelRequest",
    "Usage",
]


@dataclass(frozen=True, slots=True)
class Message:
    """One message of a conversation; its role is `system`, `user` or `assistant`."""

    role: str
    content: str


@dataclass(frozen=True, slots=True)
class ModelRequest:
    """A conversation that a model is to continue.

    `purpose` says what the answer is for (`propose`, `reflect`) and is not sent. `parameters` are
    sent as they are (`temperature`, `max_tokens`, `seed`), before those of the model itself.
    """

    messages: tuple[Message, ...]
    purpose: str = "propose"
    parameters: Mapping[str, object] = field(default_factory=dict, hash=False)


@dataclass(frozen=True, slots=True)
class Usage:
    """Tokens sent and received; what they cost, where prices are known."""

    prompt_tokens: int = 0
    completion_tokens: int = 0
    cost: float | None = None

    def __add__(self, other: Usage) -> Usage:
        costs = [cost for cost in (self.cost, other.cost) if cost is not None]
        return Usage(
            self.prompt_tokens + other.prompt_tokens,
            self.completion_tokens + other.completion_tokens,
            sum(costs) if costs else None,
        )


@dataclass(frozen=True, slots=True)
class Completion:
    """What a model answered.

    `usage` is that of all attempts, `seconds` what the last one took. `finish_reason` is the
    endpoint's word (`stop`, `length`, …), or `too-long` where the text was cut here.
    """

    text: str
    usage: Usage = Usage()
    seconds: float = 0.0
    finish_reason: str = "stop"
    attempts: int = 1


class Model(Protocol):
    """A language model."""

    name: str

    async def complete(self, request: ModelRequest) -> Completion:
        """The model's answer.

        Raises:
            ModelError: There is none.
        """
        ...


class ModelErrorKind(StrEnum):
    """Why a model has not answered."""

    NO_KEY = "no-key"
    """The endpoint wants a key, and there is none."""
    ENDPOINT = "endpoint"
    """Nobody listens there, or what listens is no such endpoint, or the answer broke off."""
    REFUSED = "refused"
    """The endpoint does not want this request, key or model."""
    RATE_LIMITED = "rate-limited"
    TIME_OUT = "time-out"
    SERVER = "server"
    """The endpoint failed (5xx)."""
    CONTEXT_OVERFLOW = "context-overflow"
    """The conversation is longer than the model can read."""
    EMPTY = "empty"
    """An answer without text: none, or a tool call."""
    TOO_LONG = "too-long"
    """An answer so long that it was not read to its end."""


class ModelError(RobotouilleError):
    """A model has not answered; the message never contains a key.

    Args:
        kind: Why.
        detail: What happened, in words, without keys.
        retry_may_help: Whether the same request may be answered a moment later.
        usage: What was paid for all the same.
        attempts: How often the endpoint was asked.
        status: The HTTP status, if there was an answer.
        retry_after: Seconds for which the endpoint asked not to be asked again.
    """

    def __init__(
        self,
        kind: ModelErrorKind,
        detail: str,
        *,
        retry_may_help: bool = False,
        usage: Usage = Usage(),  # frozen
        attempts: int = 1,
        status: int | None = None,
        retry_after: float | None = None,
    ) -> None:
        self.kind = kind
        self.detail = detail
        self.retry_may_help = retry_may_help
        self.usage = usage
        self.attempts = attempts
        self.status = status
        self.retry_after = retry_after
        super().__init__(kind, detail)

    def __str__(self) -> str:
        times = f" ({self.attempts} attempts)" if self.attempts > 1 else ""
        return f"{self.kind}: {self.detail}{times}"

    def after(self, attempts: int, usage: Usage) -> ModelError:
        """The same error at the end of several attempts, with what they used together."""
        return ModelError(
            self.kind,
            self.detail,
            retry_may_help=self.retry_may_help,
            usage=usage,
            attempts=attempts,
            status=self.status,
            retry_after=self.retry_after,
        )
