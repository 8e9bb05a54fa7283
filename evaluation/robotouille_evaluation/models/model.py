"""Requests to language models, their completions, and the errors that models raise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from robotouille.errors import RobotouilleError


@dataclass(frozen=True, slots=True)
class Message:
    """Message of a conversation with the role `system`, `user` or `assistant`."""

    role: str
    content: str


@dataclass(frozen=True, slots=True)
class ModelRequest:
    """Conversation that a model continues.

    `purpose` is the reason for the request (`propose`, `reflect`); it is not sent. `parameters`
    (`temperature`, `max_tokens`, `seed`) override the parameters of the model.
    """

    messages: tuple[Message, ...]
    purpose: str = "propose"
    parameters: Mapping[str, object] = field(default_factory=dict, hash=False)


@dataclass(frozen=True, slots=True)
class Usage:
    """Tokens sent and received, and their cost; None if prices or tokens are unknown."""

    prompt_tokens: int = 0
    completion_tokens: int = 0
    cost: float | None = None

    def __add__(self, other: Usage) -> Usage:
        """Return the sum, whose cost is unknown if one of the costs is."""
        return Usage(
            self.prompt_tokens + other.prompt_tokens,
            self.completion_tokens + other.completion_tokens,
            None if self.cost is None or other.cost is None else self.cost + other.cost,
        )


NOTHING = Usage(cost=0.0)
"""Usage of a request that was not answered, and of no requests."""


@dataclass(frozen=True, slots=True)
class Completion:
    """Answer of a model.

    `usage` covers all attempts; `seconds` is the duration of the last one. `finish_reason` is the
    endpoint's word (`stop`, `length`, …), or `too-long` if the text was cut here.
    """

    text: str
    usage: Usage = Usage()
    seconds: float = 0.0
    finish_reason: str = "stop"
    attempts: int = 1


class Model(Protocol):
    """Language model that answers requests."""

    name: str

    async def complete(self, request: ModelRequest) -> Completion:
        """Return the model's answer, or raise `ModelError`."""
        ...


class ModelErrorKind(StrEnum):
    """Reason why a model did not answer."""

    NO_KEY = "no-key"
    """The endpoint requires a key and none is set."""
    ENDPOINT = "endpoint"
    """There is no endpoint at the address, or its response is not a chat completion."""
    REFUSED = "refused"
    """The endpoint does not accept this request, key or model."""
    RATE_LIMITED = "rate-limited"
    TIME_OUT = "time-out"
    SERVER = "server"
    """The endpoint failed (status 5xx)."""
    CONTEXT_OVERFLOW = "context-overflow"
    """The conversation is longer than the model's context."""
    EMPTY = "empty"
    """The response has no text, for example because it is a tool call."""


class ModelError(RobotouilleError):
    """Failure of a model to answer; its text never contains a key.

    Args:
        kind: Reason.
        detail: Explanation, without keys.
        retry_may_help: True if the endpoint may answer the same request when asked again.
        usage: Tokens that were paid for nevertheless.
        attempts: Number of requests sent.
    """

    def __init__(
        self,
        kind: ModelErrorKind,
        detail: str,
        *,
        retry_may_help: bool = False,
        usage: Usage = NOTHING,
        attempts: int = 1,
    ) -> None:
        self.kind = kind
        self.detail = detail
        self.retry_may_help = retry_may_help
        self.usage = usage
        self.attempts = attempts
        # Only positional arguments survive pickling between processes.
        super().__init__(kind, detail)

    def __str__(self) -> str:
        times = f" ({self.attempts} attempts)" if self.attempts > 1 else ""
        return f"{self.kind}: {self.detail}{times}"

    def in_total(self, attempts: int, usage: Usage) -> ModelError:
        """Return this error with the number and usage of all attempts."""
        self.attempts, self.usage = attempts, usage
        return self


HEADER = "Valid Actions:"


def valid_actions(request: ModelRequest) -> tuple[str, ...]:
    """Return the sentences below `Valid Actions:` in the last user message that has such a line.

    The list ends at an empty line or at the goal. It is empty for requests without valid actions,
    such as requests for a reflection.
    """
    for message in reversed(request.messages):
        if message.role == "user" and HEADER in message.content:
            return tuple(_below_header(message.content.splitlines()))
    return ()


def _below_header(lines: list[str]) -> list[str]:
    found: list[str] = []
    below = False
    for line in (each.strip() for each in lines):
        if line == HEADER:
            found, below = [], True
        elif line.startswith("Goal:"):
            below = False
        elif not line:
            below = below and not found
        elif below:
            found.append(line)
    return found
