"""What becomes of an answer when the world has moved since the model looked."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum

from robotouille_evaluation.realtime.changes import known_lines

__all__ = ["Late", "Look", "holds"]

WORD = re.compile(r"[\w-]+")


class Late(StrEnum):
    """Which answers are acted upon although steps have passed, from the boldest to the strictest.

    Whatever is acted upon and is not valid any more the world refuses.
    """

    APPLY = "apply"
    """All of them."""
    REVALIDATE = "revalidate"
    """Those that are still valid, and name nothing of which the observation says something else
    now."""
    DROP = "drop"
    """Those since which nothing has changed in the observation."""


@dataclass(frozen=True, slots=True)
class Look:
    """What a player sees after `step` steps, with the sentences of its valid actions."""

    step: int
    text: str
    valid: tuple[str, ...]


def holds(late: Late, action: str, then: Look, now: Look) -> bool:
    """Whether an action that was chosen on one look is acted upon at another.

    Args:
        action: Its sentence.
        then: What the model was shown.
        now: How it is.
    """
    if late is Late.APPLY or then.step == now.step:
        return True
    before, after = known_lines(then.text), known_lines(now.text)
    if late is Late.DROP:
        return before == after
    things = set(WORD.findall(action)) & {line.partition(" ")[0] for line in (*before, *after)}
    return action in now.valid and _about(things, before) == _about(things, after)


def _about(things: set[str], lines: tuple[str, ...]) -> list[str]:
    return [line for line in lines if things & set(WORD.findall(line))]
