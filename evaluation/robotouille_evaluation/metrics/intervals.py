"""How sure a number is: bootstrap intervals, and paired tests between two agents.

Seeded: the same rows give the same numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

__all__ = ["Interval", "bootstrap", "mcnemar_test", "permutation_test"]

RESAMPLES = 2000
CHUNK = 2_000_000
"""Draws that are in memory at once."""
MAX_EXACT = 12
"""Pairs up to which all swaps are tried."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean with an interval that holds it with some confidence (0.95 if not said otherwise);
    `low` and `high` are None where the values tell of none."""

    mean: float
    low: float | None
    high: float | None
    count: int


def bootstrap(
    clusters: Sequence[Sequence[float]],
    *,
    level: float = 0.95,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> Interval | None:
    """The mean of all values, with a percentile bootstrap interval (Efron and Tibshirani, 1993).

    Clusters are drawn with replacement, each with all its values: trials of one instance, which
    are alike, are a cluster. Independent values are clusters of one. None without values.

    Where all values are 0 or all are 1, every sample is the same and would pretend certainty: then
    it is the exact interval of Clopper and Pearson (1934) for so many clusters. Where the clusters
    have another mean in common, or there is one alone, no interval is known.

    Args:
        clusters: The values, those that belong together side by side.
        level: The confidence, between 0 and 1.
        resamples: How many samples are drawn.
        seed: Of the draws.
    """
    sums = np.array([sum(each) for each in clusters if each], dtype=float)
    counts = np.array([len(each) for each in clusters if each], dtype=float)
    if not len(sums):
        return None
    total = int(counts.sum())
    mean = float(sums.sum() / total)
    if len(set(sums / counts)) == 1:
        if mean in (0.0, 1.0):
            return _never_or_always(mean, len(sums), total, level)
        return Interval(mean, None, None, total)
    generator = np.random.default_rng(seed)
    means = []
    at_once = max(1, CHUNK // len(sums))
    for begin in range(0, resamples, at_once):
        size = (min(at_once, resamples - begin), len(sums))
        drawn = generator.integers(len(sums), size=size)
        means.append(sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1))
    tail = (1 - level) / 2
    low, high = np.quantile(np.concatenate(means), (tail, 1 - tail))
    return Interval(mean, float(low), float(high), total)


def _never_or_always(mean: float, clusters: int, count: int, level: float) -> Interval:
    reach = 1 - ((1 - level) / 2) ** (1 / clusters)
    low, high = (0.0, reach) if mean == 0 else (1 - reach, 1.0)
    return Interval(mean, low, high, count)


def permutation_test(
    one: Sequence[float],
    other: Sequence[float],
    *,
    resamples: int = 10_000,
    seed: int = 0,
) -> float:
    """The two-sided p-value of a paired permutation test of equal means (Fisher, 1935).

    Each pair is swapped or not: all ways up to 12 pairs that differ, else `resamples` drawn ones
    (then counted with the observed one, so that it is never 0).

    Raises:
        ValueError: The two are not of the same length.
    """
    if len(one) != len(other):
        raise ValueError(f"{len(one)} values are not paired with {len(other)}")
    pairs = zip(one, other, strict=True)
    differences = np.array([a - b for a, b in pairs if a != b], dtype=float)
    number = len(differences)
    if not number:
        return 1.0
    observed = abs(float(differences.sum())) - 1e-9
    if number <= MAX_EXACT:
        ways = np.arange(2**number)[:, None] >> np.arange(number) & 1
        return float((abs((1 - 2 * ways) @ differences) >= observed).mean())
    generator = np.random.default_rng(seed)
    extreme, at_once = 0, max(1, CHUNK // number)
    for begin in range(0, resamples, at_once):
        size = (min(at_once, resamples - begin), number)
        signs = 1 - 2 * generator.integers(2, size=size)
        extreme += int(np.count_nonzero(abs(signs @ differences) >= observed))
    return (extreme + 1) / (resamples + 1)


def mcnemar_test(one: Sequence[bool], other: Sequence[bool]) -> float:
    """The two-sided p-value of McNemar's exact test: do two agents succeed equally often?

    Only pairs in which one alone succeeds count; each is as likely to be either's (McNemar, 1947).

    Raises:
        ValueError: The two are not of the same length.
    """
    if len(one) != len(other):
        raise ValueError(f"{len(one)} values are not paired with {len(other)}")
    pairs = list(zip(one, other, strict=True))
    only_one = sum(a and not b for a, b in pairs)
    only_other = sum(b and not a for a, b in pairs)
    number, fewer = only_one + only_other, min(only_one, only_other)
    ways = sum(comb(number, k) for k in range(fewer + 1))
    return float(min(1.0, 2 * ways / 2**number))
