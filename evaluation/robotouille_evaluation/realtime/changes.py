"""What has changed since a model last looked, in few words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from robotouille_evaluation.models.valid_actions import HEADER

__all__ = ["digest", "estimated_tokens", "known_lines"]

CHARACTERS_A_TOKEN = 4


def estimated_tokens(text: str) -> int:
    """Tokens of a text, estimated without a tokenizer: one for four characters, rounded up."""
    return -(-len(text) // CHARACTERS_A_TOKEN)


def known_lines(text: str) -> tuple[str, ...]:
    """The lines of an observation that say how things are: all but those of the valid actions."""
    found, listing = [], False
    for line in text.splitlines():
        if line == HEADER:
            listing = True
        elif not line:
            listing = False
        elif not listing:
            found.append(line)
    return tuple(found)


def digest(then: str, now: str, steps: int, deeds: Sequence[str], tokens: int) -> str:
    """What was done and what has changed between two observations.

    Args:
        steps: How many steps have passed.
        deeds: What was done in them, in order. The latest come first in the digest.
        tokens: The most that it may take, by `estimated_tokens`. What does not fit is counted.

    Returns:
        Nothing where not even its first line fits.
    """
    head = f"Since you last looked {steps} step{'s have' if steps != 1 else ' has'} passed."
    lines = [*(f"* {deed}" for deed in reversed(deeds)), *_changes(then, now)]
    for shown in range(len(lines), -1, -1):
        left = len(lines) - shown
        more = [f"({left} more lines are left out.)"] if left else []
        text = "\n".join([head, *lines[:shown], *more])
        if estimated_tokens(text) <= tokens:
            return text
    return ""


def _changes(then: str, now: str) -> Iterator[str]:
    """Lines that came, then lines that went, each in the order of its observation."""
    before, after = known_lines(then), known_lines(now)
    for sign, lines, others in (("+", after, before), ("-", before, after)):
        left = Counter(others)
        for line in lines:
            if left[line] > 0:
                left[line] -= 1
            else:
                yield f"{sign} {line}"
