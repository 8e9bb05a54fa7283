"""What is asked of a language model, and what it answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Protocol

__all__ = ["Completion", "Message", "Model", "ModelRequest", "Usage"]


@dataclass(frozen=True, slots=True)
class Message:
    """One message of a chat: `role` is `system`, `user` or `assistant`."""

    role: str
    content: str


@dataclass(frozen=True, slots=True)
class ModelRequest:
    """A chat to be continued."""

    messages: tuple[Message, ...]
    purpose: str = "propose"
    parameters: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True, slots=True)
class Usage:
    """Tokens, and what they cost where prices are known."""

    prompt_tokens: int = 0
    completion_tokens: int = 0
    cost: float | None = None


@dataclass(frozen=True, slots=True)
class Completion:
    """An answer, after how many seconds and attempts."""

    text: str
    usage: Usage = field(default_factory=Usage)
    seconds: float = 0.0
    finish_reason: str = "stop"
    attempts: int = 1


class Model(Protocol):
    """Something that continues chats."""

    name: str

    async def complete(self, request: ModelRequest) -> Completion:
        """The answer. Raises ModelError."""
        ...
