"""Bootstrap intervals, and paired tests between two agents.

They are seeded, so equal rows give equal numbers.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Sequence
from math import comb, sqrt
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from robotouille.domain.fast_failing import fast_failing
from robotouille.domain.json_files import parse_json
from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.files.reading import read_text
from robotouille.html_report.intervals import Interval
from robotouille_evaluation.metrics.rows import Category, Pair, ResultRow

RESAMPLES = 2000
CHUNK = 2_000_000
"""Draws that are in memory at once."""
MAX_EXACT = 12
"""Most pairs for which all swaps are tried."""


def bootstrap(
    clusters: Sequence[Sequence[float]],
    *,
    level: float = 0.95,
    resamples: int = RESAMPLES,
    seed: int = 0,
    binary: bool = True,
) -> Interval | None:
    """Return the mean with a percentile bootstrap interval (Efron and Tibshirani, 1993).

    Whole clusters are drawn with replacement. Trials of one instance resemble each other, so they
    are a cluster; independent values are clusters of one.

    If all binary values are 0, or all are 1, every sample is the same and the bootstrap would claim
    certainty. The interval is then the exact one of Clopper and Pearson (1934) for that many
    clusters. There is no interval for one cluster, or for clusters with equal means.

    The standard error is that of a ratio of sums of clusters. With one value in each of n clusters,
    it is the standard deviation (with n - 1) / sqrt(n). It is left out if all clusters have equal
    means.

    Args:
        clusters: Values, grouped.
        level: Confidence, between 0 and 1.
        resamples: Number of samples.
        seed: Seed of the samples.
        binary: Values of 0 and 1 are failures and successes.

    Returns:
        None without values.
    """
    sums = np.array([sum(each) for each in clusters if each], dtype=float)
    counts = np.array([len(each) for each in clusters if each], dtype=float)
    if not len(sums):
        return None
    total = int(counts.sum())
    mean = float(sums.sum() / total)
    if len(set(sums / counts)) == 1:
        if binary and mean in (0.0, 1.0):
            return _never_or_always(mean, len(sums), total, level)
        return Interval(mean, None, None, total)
    generator = np.random.default_rng(seed)
    means = []
    at_once = max(1, CHUNK // len(sums))
    # In chunks, because all draws of a large table would not fit in memory.
    for begin in range(0, resamples, at_once):
        size = (min(at_once, resamples - begin), len(sums))
        drawn = generator.integers(len(sums), size=size)
        means.append(sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1))
    tail = (1 - level) / 2
    low, high = np.quantile(np.concatenate(means), (tail, 1 - tail))
    return Interval(mean, float(low), float(high), total, _standard_error(sums, counts, mean))


def _standard_error(sums: np.ndarray, counts: np.ndarray, mean: float) -> float:
    number = len(sums)
    squares = float(((sums - mean * counts) ** 2).sum())
    return sqrt(number / (number - 1) * squares) / float(counts.sum())


def _never_or_always(mean: float, clusters: int, count: int, level: float) -> Interval:
    reach = 1 - ((1 - level) / 2) ** (1 / clusters)
    low, high = (0.0, reach) if mean == 0 else (1 - reach, 1.0)
    return Interval(mean, low, high, count)


def rank_correlation(one: Sequence[float], other: Sequence[float]) -> float | None:
    """Return Spearman's rank correlation (1904). Equal values share their mean rank.

    Returns:
        None if all values of a sequence are equal.

    Raises:
        ValueError: The lengths differ.
    """
    if len(one) != len(other):
        raise ValueError(f"{len(one)} values are not paired with {len(other)}")
    if len(set(one)) < 2 or len(set(other)) < 2:
        return None
    return float(np.corrcoef(_ranks(one), _ranks(other))[0, 1])


def _ranks(values: Sequence[float]) -> np.ndarray:
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    ranks: np.ndarray = (counts.cumsum() - (counts - 1) / 2)[places]
    return ranks


def permutation_test(
    one: Sequence[float],
    other: Sequence[float],
    *,
    resamples: int = 10_000,
    seed: int = 0,
) -> float:
    """Return the two-sided p-value of a paired permutation test of equal means (Fisher, 1935).

    Up to 12 pairs with different values, all swaps are tried. For more pairs, `resamples` swaps are
    drawn and counted together with the observed one, so the value is never 0.

    Raises:
        ValueError: The lengths differ.
    """
    if len(one) != len(other):
        raise ValueError(f"{len(one)} values are not paired with {len(other)}")
    pairs = zip(one, other, strict=True)
    differences = np.array([a - b for a, b in pairs if a != b], dtype=float)
    number = len(differences)
    if not number:
        return 1.0
    # The tolerance counts swaps with an equal sum as extreme despite rounding.
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
    """Return the two-sided p-value of McNemar's exact test of equal success rates (1947).

    Only pairs in which one agent alone succeeds count. If the rates are equal, each agent is as
    likely to be that one.

    Raises:
        ValueError: The lengths differ.
    """
    if len(one) != len(other):
        raise ValueError(f"{len(one)} values are not paired with {len(other)}")
    pairs = list(zip(one, other, strict=True))
    only_one = sum(a and not b for a, b in pairs)
    only_other = sum(b and not a for a, b in pairs)
    number, fewer = only_one + only_other, min(only_one, only_other)
    ways = sum(comb(number, k) for k in range(fewer + 1))
    return float(min(1.0, 2 * ways / 2**number))


def success_test(one: Sequence[float], other: Sequence[float]) -> tuple[float, str]:
    """Return the two-sided p-value of a paired test of equal success rates, and the test's name.

    Values are successes (0 or 1) or, for episodes that were played several times, their means.

    Raises:
        ValueError: The lengths differ.
    """
    if {0.0, 1.0}.issuperset(one) and {0.0, 1.0}.issuperset(other):
        return mcnemar_test([*map(bool, one)], [*map(bool, other)]), "McNemar, exact"
    return permutation_test(one, other), "permutation"


def by_pair(rows: Iterable[ResultRow]) -> dict[Pair, list[ResultRow]]:
    """Return an agent's rows by pair: several, if it played an episode in several runs."""
    found: dict[Pair, list[ResultRow]] = {}
    for row in rows:
        found.setdefault(row.pair, []).append(row)
    return found


class Label(BaseModel):
    """Label of one failed episode.

    `recording` is as in the row. `run` is needed if several runs have a recording of that name.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    recording: str
    category: Category
    subcategory: str = ""
    labeller: str = ""
    note: str = ""
    run: str = ""


_labels = fast_failing(TypeAdapter(tuple[Label, ...]).core_schema)


def read_labels(path: Path) -> tuple[Label, ...]:
    """Return the labels of a file: a JSON list of objects, or CSV with the same column names.

    Raises:
        FileError: The file cannot be read or is invalid.
    """
    try:
        text = read_text(path)
        is_csv = path.suffix == ".csv"
        rows = list(csv.DictReader(text.splitlines())) if is_csv else parse_json(text, str(path))
        found: tuple[Label, ...] = _labels.validate_python(rows)
        return found
    except OSError as error:
        fault = Fault("", f"cannot be read: {error.strerror or error}")
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        fault = Fault(".".join(map(str, first["loc"])), first["msg"])
    except (ValueError, csv.Error) as error:
        fault = Fault("", f"not a list of labels: {error}")
    raise FileError(str(path), [fault])


def cohens_kappa(one: Sequence[str], other: Sequence[str]) -> float | None:
    """Return Cohen's kappa (1960): (p - e) / (1 - e).

    `p` is the share of equal labels and `e` the share expected by chance. 1 is full agreement, 0 is
    chance.

    Returns:
        None without labels, or if both give the same label to everything.

    Raises:
        ValueError: The lengths differ.
    """
    if len(one) != len(other):
        raise ValueError(f"{len(one)} labels are not paired with {len(other)}")
    number = len(one)
    if not number:
        return None
    equal = sum(a == b for a, b in zip(one, other, strict=True)) / number
    left, right = Counter(one), Counter(other)
    chance = sum(left[label] * right[label] for label in left) / number**2
    return None if chance == 1 else (equal - chance) / (1 - chance)


def paired(rows: Sequence[ResultRow], labels: Sequence[Label]) -> list[tuple[ResultRow, Label]]:
    """Return the rows of failed episodes with people's labels of the same recordings.

    Raises:
        RobotouilleError: A label names no run, and several runs have its recording.
    """
    found: dict[str | None, list[ResultRow]] = {}
    for row in rows:
        found.setdefault(row.recording, []).append(row)
    pairs = []
    for label in labels:
        meant = [r for r in found.get(label.recording, ()) if label.run in ("", r.run)]
        if len(meant) > 1:
            runs = " and ".join(sorted({row.run for row in meant}))
            raise RobotouilleError(
                f"the runs {runs} all have {label.recording}; choose one in a column `run`"
            )
        pairs += [(row, label) for row in meant if row.measures.failure]
    return pairs


def agreement(rows: Sequence[ResultRow], labels: Sequence[Label]) -> float | None:
    """Return Cohen's kappa between the rows' categories and people's labels; None without pairs."""
    pairs = [
        (row.measures.failure.category, label.category.value)
        for row, label in paired(rows, labels)
        if row.measures.failure
    ]
    return cohens_kappa([a for a, _ in pairs], [b for _, b in pairs])
