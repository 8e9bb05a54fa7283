"""Estimates with 95 % confidence intervals."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

Z = 1.959963984540054
"""97.5th percentile of the normal distribution."""
RESAMPLES = 1000
MAX_CELLS = 4_000_000
"""Array elements that the bootstrap allocates at once (32 MB)."""


@dataclass(frozen=True, slots=True)
class Interval:
    """Estimate from `count` values, with the bounds of its confidence interval.

    The bounds are None if the values do not determine an interval. `error` is the standard error,
    if it was computed.
    """

    estimate: float
    low: float | None
    high: float | None
    count: int
    error: float | None = None

    def text(self, number: Callable[[float], str], bound: Callable[[float], str] = str) -> str:
        """Return the estimate and its bounds in words, such as `47 % (37–57)`."""
        if self.low is None or self.high is None:
            return number(self.estimate)
        return f"{number(self.estimate)} ({bound(self.low)}–{bound(self.high)})"


def wilson_interval(successes: int, count: int) -> Interval | None:
    """Return a share with its score interval (Wilson, 1927), or None if `count` is 0.

    The interval assumes independent trials. Unlike the normal approximation it stays within 0
    and 1, and it is useful for the few episodes of a study.
    """
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
    """Return the median with a percentile bootstrap interval (Efron and Tibshirani, 1993).

    The bootstrap draws clusters with replacement, each with all its values, because the values of
    a cluster (such as the rounds of one pair of players) are correlated. Fewer than three clusters
    give no bounds. Without values the result is None.

    Args:
        clusters: The cluster of each value.
    """
    if not values:
        return None
    order = np.argsort(np.array(values, dtype=float), kind="stable")
    ordered = np.array(values, dtype=float)[order]
    numbers = {cluster: place for place, cluster in enumerate(dict.fromkeys(clusters))}
    cluster_of_value = np.array([numbers[each] for each in clusters])[order]
    median = float(np.median(ordered))
    if len(numbers) < 3:
        return Interval(median, None, None, len(values))
    # Seeded, so that the same values give the same page.
    generator = np.random.default_rng(seed)
    medians, at_once = [], max(1, MAX_CELLS // len(values))
    for begin in range(0, RESAMPLES, at_once):
        size = (min(at_once, RESAMPLES - begin), len(numbers))
        drawn = generator.integers(len(numbers), size=size)
        times = np.stack([np.bincount(row, minlength=len(numbers)) for row in drawn])
        medians.append(_weighted_medians(ordered, times[:, cluster_of_value]))
    low, high = np.quantile(np.concatenate(medians), (0.025, 0.975))
    return Interval(median, float(low), float(high), len(values))


def _weighted_medians(ordered: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the median of each sample. A row of `weights` counts how often a value is in it."""
    below = weights.cumsum(axis=1)
    whole = below[:, -1:]
    lower = (2 * below >= whole).argmax(axis=1)
    upper = (2 * below > whole).argmax(axis=1)
    medians: np.ndarray = (ordered[lower] + ordered[upper]) / 2
    return medians
