"""How sure a number is: intervals of 95 %. Seeded: the same values give the same numbers."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

__all__ = ["Interval", "median_interval", "share_interval"]

Z = 1.959963984540054
"""The 97.5th percentile of the normal distribution."""
RESAMPLES = 1000
CELLS = 4_000_000
"""Numbers that are in memory at once."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A number, between which bounds it lies, and of how many values it is. There are no bounds
    where the values tell of none."""

    middle: float
    low: float | None
    high: float | None
    count: int


def share_interval(successes: int, count: int) -> Interval | None:
    """A share with Wilson's score interval (1927), as if all were independent; None of nothing."""
    if not count:
        return None
    share = successes / count
    scale = 1 + Z * Z / count
    middle = (share + Z * Z / (2 * count)) / scale
    reach = Z / scale * sqrt(share * (1 - share) / count + Z * Z / (4 * count * count))
    return Interval(share, max(0.0, middle - reach), min(1.0, middle + reach), count)


def median_interval(
    values: Sequence[float], clusters: Sequence[Hashable], seed: int = 0
) -> Interval | None:
    """The median with a percentile bootstrap interval (Efron and Tibshirani, 1993).

    Clusters are drawn with replacement, each with all its values: what belongs together, as the
    rounds of a pair, is alike. Of fewer than three clusters no interval is known. None of nothing.

    Args:
        clusters: What each value belongs to.
    """
    if not values:
        return None
    order = np.argsort(np.array(values, dtype=float), kind="stable")
    ordered = np.array(values, dtype=float)[order]
    numbers = {cluster: place for place, cluster in enumerate(dict.fromkeys(clusters))}
    belongs = np.array([numbers[each] for each in clusters])[order]
    middle = float(np.median(ordered))
    if len(numbers) < 3:
        return Interval(middle, None, None, len(values))
    generator = np.random.default_rng(seed)
    medians, at_once = [], max(1, CELLS // len(values))
    for begin in range(0, RESAMPLES, at_once):
        size = (min(at_once, RESAMPLES - begin), len(numbers))
        drawn = generator.integers(len(numbers), size=size)
        times = np.stack([np.bincount(row, minlength=len(numbers)) for row in drawn])
        medians.append(_medians(ordered, times[:, belongs]))
    low, high = np.quantile(np.concatenate(medians), (0.025, 0.975))
    return Interval(middle, float(low), float(high), len(values))


def _medians(ordered: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The medians of samples, each of which has the ordered values so many times."""
    below = times.cumsum(axis=1)
    whole = below[:, -1:]
    lower = (2 * below >= whole).argmax(axis=1)
    upper = (2 * below > whole).argmax(axis=1)
    medians: np.ndarray = (ordered[lower] + ordered[upper]) / 2
    return medians
