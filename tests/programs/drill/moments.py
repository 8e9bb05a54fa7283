"""The times at which the server is killed: random ones and critical ones."""

from __future__ import annotations

import random
import signal
from dataclasses import dataclass
from enum import StrEnum

__all__ = ["Kill", "When", "draw_kills"]

MAX_IN_ROW = 2
"""Consecutive kills before the server listens; clients give up a request after 15 s."""


class When(StrEnum):
    """Activity of the server at a kill."""

    STARTING = "starting"
    RETURNING = "returning"
    PLAYING = "playing"
    EVENT = "event"


@dataclass(frozen=True, slots=True)
class Kill:
    """A kill, `delay` seconds after the process started (`starting`), began to listen
    (`returning`), had most players back (`playing`), or started or ended an episode (`event`).
    """

    when: When
    delay: float
    signal: signal.Signals


WEIGHTS = {When.STARTING: 20, When.RETURNING: 20, When.PLAYING: 45, When.EVENT: 15}
DELAYS = {
    When.STARTING: (0.0, 3.0),
    When.RETURNING: (0.0, 1.5),
    When.PLAYING: (0.0, 4.0),
    When.EVENT: (0.0, 0.02),
}


def draw_kills(seed: int, count: int) -> list[Kill]:
    """Draw `count` SIGKILLs from a seed, and a few SIGTERMs without time to drain, which make up
    less than a tenth of all kills. The last kill is a SIGKILL. The first comes during play.
    """
    chance = random.Random(f"kills {seed}")
    kills: list[Kill] = []
    hard = 0
    while hard < count:
        (when,) = chance.choices(list(WEIGHTS), list(WEIGHTS.values()))
        last = kills[-MAX_IN_ROW:]
        enough = sum(k.when is When.STARTING for k in last) == MAX_IN_ROW
        if not kills or (when is When.STARTING and enough):
            when = When.PLAYING
        term = when is not When.STARTING and chance.random() < 0.1
        number = signal.SIGTERM if term else signal.SIGKILL
        hard += not term
        kills.append(Kill(when, chance.uniform(*DELAYS[when]), number))
    return kills
