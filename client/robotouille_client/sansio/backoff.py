"""How long to wait before a lost connection is sought again."""

from __future__ import annotations

import random
from collections.abc import Iterator

__all__ = ["FIRST_DELAY", "MAX_DELAY", "pauses"]

FIRST_DELAY, MAX_DELAY = 0.1, 5.0


def pauses(rng: random.Random) -> Iterator[float]:
    """Seconds before each attempt, without end: from FIRST_DELAY to MAX_DELAY.

    They double on the whole; each is drawn at random, the last ones too, so that the clients of a
    server do not come back all at once.
    """
    longest = FIRST_DELAY
    while True:
        longest = min(2 * longest, MAX_DELAY)
        yield longest * rng.uniform(0.5, 1.0)
