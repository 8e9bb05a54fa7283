"""Choices that follow from a seed, the same on every machine and in every version of Python.

Of `random.Random`, Python promises to keep only `random()` for a seed; `choice`, `shuffle` and
`sample` may change. So every choice here is made of `random()` alone.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import TypeVar

__all__ = ["SeededRng"]

T = TypeVar("T")


class SeededRng:
    """A stream of choices; equal seeds, equal streams."""

    def __init__(self, seed: str) -> None:
        self._random = random.Random(seed).random

    def below(self, limit: int) -> int:
        """A number from 0 to `limit` - 1."""
        return int(self._random() * limit)

    def between(self, low: int, high: int) -> int:
        """A number from `low` to `high`, both included."""
        return low + self.below(high - low + 1)

    def happens(self, probability: float) -> bool:
        """True with a probability."""
        return self._random() < probability

    def one_of(self, values: Sequence[T]) -> T:
        """One of some values, each as likely."""
        return values[self.below(len(values))]

    def shuffled(self, values: Sequence[T]) -> list[T]:
        """The values in another order, each order as likely (Fisher and Yates)."""
        result = list(values)
        for last in range(len(result) - 1, 0, -1):
            other = self.below(last + 1)
            result[last], result[other] = result[other], result[last]
        return result
