"""What of an exchange a strategy says again in its next request (paper, ablations)."""

from __future__ import annotations

from enum import StrEnum

from robotouille_evaluation.models.model import Message

__all__ = ["History", "remembered"]


class History(StrEnum):
    """Variants of ReAct."""

    FULL = "full"
    NONE = "none"
    LAST_ACTION = "last-action"
    LAST_REASONING_ACTION = "last-reasoning-action"
    LAST_OBSERVATION_REASONING_ACTION = "last-obs-reasoning-action"


def remembered(
    history: History,
    before: list[tuple[str, str]],
    prompt: str,
    answer: str,
    observation: str,
    reasoning: str,
    action: str,
) -> list[tuple[str, str]]:
    """Pairs of what was asked and answered that go before the next request."""
    words = f"Previous Reasoning: {reasoning}\nPrevious Action: {action}"
    match history:
        case History.FULL:
            return [*before, (prompt, answer)]
        case History.NONE:
            return []
        case History.LAST_ACTION:
            return [("Previous Observation: Omitted", f"Previous Action: {action}")]
        case History.LAST_REASONING_ACTION:
            return [("Previous Observation: Omitted", words)]
        case History.LAST_OBSERVATION_REASONING_ACTION:
            return [(f"Previous Observation: {observation}\n", words)]


def as_messages(pairs: list[tuple[str, str]]) -> list[Message]:
    """Pairs as turns of a chat."""
    return [
        Message(role, content)
        for pair in pairs
        for role, content in zip(("user", "assistant"), pair, strict=True)
    ]
