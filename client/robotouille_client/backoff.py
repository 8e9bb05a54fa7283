"""How long to wait before a lost connection is sought again."""

from __future__ import annotations

import random
from collections.abc import Iterator

__all__ = ["FIRST_DELAY", "LONGEST_DELAY", "pauses"]

FIRST_DELAY, LONGEST_DELAY = 0.1, 5.0


def pauses(chance: random.Random) -> Iterator[float]:
    """Seconds before each attempt, without end: from FIRST_DELAY to LONGEST_DELAY.

    They double on the whole; each is drawn by chance, the last ones too, so that the clients of a
    server do not come back all at once.
    """
    longest = FIRST_DELAY
    while True:
        longest = min(2 * longest, LONGEST_DELAY)
        yield longest * chance.uniform(0.5, 1.0)
