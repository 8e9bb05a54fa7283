"""The valid actions that a conversation's last observation lists."""

from __future__ import annotations

from robotouille_evaluation.models.model import ModelRequest

__all__ = ["HEADER", "valid_actions"]

HEADER = "Valid Actions:"


def valid_actions(request: ModelRequest) -> tuple[str, ...]:
    """The sentences below the last line `Valid Actions:`, up to an empty line or the goal.

    Args:
        request: A conversation; only its last message with such a line counts.

    Returns:
        Nothing where there is no such line, as in a request for reflection.
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
