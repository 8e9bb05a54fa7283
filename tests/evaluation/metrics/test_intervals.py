"""Bootstrap intervals and paired tests: hand-computed cases and properties."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille_evaluation.metrics.statistics import (
    Interval,
    bootstrap,
    mcnemar_test,
    permutation_test,
    rank_correlation,
)
from tests.support.thorough import thorough

VALUES = st.lists(st.floats(-100, 100), min_size=1, max_size=30)


def test_interval_of_a_hundred_coins() -> None:
    # 47 of 100: the normal approximation is 0.47 ± 1.96 sqrt(0.47 · 0.53 / 100) = 0.372 to 0.568.
    found = bootstrap([[1.0]] * 47 + [[0.0]] * 53)
    assert found is not None
    assert (found.estimate, found.count) == (0.47, 100)
    assert found.low == pytest.approx(0.372, abs=0.015)
    assert found.high == pytest.approx(0.568, abs=0.015)


def test_standard_error_by_hand() -> None:
    # 9 of 30: sqrt(0.3 · 0.7 / 29) = 0.0851, which the paper prints as 0.085.
    found = bootstrap([[1.0]] * 9 + [[0.0]] * 21)
    assert found is not None and found.error == pytest.approx(0.0851, abs=5e-5)
    # Means 1/3 and 1 with weights 3 and 1: residuals of 0.5 are -0.5 and 0.5, and 2 · 0.5 / 16.
    uneven = bootstrap([[1.0, 0.0, 0.0], [1.0]])
    assert uneven is not None and uneven.error == pytest.approx((2 * 0.5) ** 0.5 / 4)
    # Two equal trials of each instance say no more than one.
    twice = bootstrap([[1.0, 1.0]] * 9 + [[0.0, 0.0]] * 21)
    assert twice is not None and twice.error == pytest.approx(found.error)


def width(interval: Interval) -> float:
    assert interval.low is not None and interval.high is not None
    return interval.high - interval.low


def test_clusters_widen_the_interval() -> None:
    """Ten equal trials of an instance have no more information than one."""
    alike = bootstrap([[float(i % 2)] * 10 for i in range(10)])
    single = bootstrap([[float(i % 2)] for i in range(100)])
    assert alike is not None
    assert single is not None
    assert alike.estimate == single.estimate == 0.5
    assert width(alike) > 2 * width(single)


def test_no_interval_for_equal_clusters() -> None:
    """One instance with two seeds has no information about other instances."""
    assert bootstrap([[1.0, 0.0]]) == Interval(0.5, None, None, 2)
    assert bootstrap([[0.0, 1.0], [1.0, 0.0]]) == Interval(0.5, None, None, 4)
    assert bootstrap([[3.0], [3.0]]) == Interval(3.0, None, None, 2)
    known = bootstrap([[0.0, 1.0], [1.0, 1.0]])
    assert known is not None and known.low is not None


def test_interval_of_constant_successes() -> None:
    # Ten of ten: below 1 - 0.025^(1/10) = 0.3085 of failures (Clopper and Pearson).
    always, never = bootstrap([[1.0]] * 10), bootstrap([[0.0, 0.0]] * 10)
    assert always == Interval(1.0, pytest.approx(1 - 0.3085, abs=1e-4), 1.0, 10)
    assert never == Interval(0.0, 0.0, pytest.approx(0.3085, abs=1e-4), 20)


@thorough(50)
@given(VALUES)
def test_interval_contains_the_mean_and_is_reproducible(values: list[float]) -> None:
    clusters = [[value] for value in values]
    found = bootstrap(clusters, resamples=200)
    assert found == bootstrap(clusters, resamples=200)
    assert found is not None
    if found.low is None or found.high is None:
        assert len({*values}) == 1
    elif {*values} not in ({0.0}, {1.0}):
        assert min(values) - 1e-9 <= found.low <= found.high <= max(values) + 1e-9


def test_permutation_test_by_hand() -> None:
    # Differences 1, 2, 3: sums of ±1 ±2 ±3 are as far from 0 as 6 in 2 of 8 ways.
    assert permutation_test([1, 2, 3], [0, 0, 0]) == 2 / 8
    # 1, 1, -1 sum to 1; every way sums to 1 or 3 or their negatives: all 8.
    assert permutation_test([1, 1, 0], [0, 0, 1]) == 1.0
    assert permutation_test([1, 2], [1, 2]) == 1.0


@thorough(50)
@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), max_size=10))
def test_permutation_test_is_symmetric(pairs: list[tuple[float, float]]) -> None:
    one, other = [a for a, _ in pairs], [b for _, b in pairs]
    assert permutation_test(one, other) == permutation_test(other, one)
    assert 0 < permutation_test(one, other) <= 1


def test_mcnemar_by_hand() -> None:
    # One alone wins 6 times, the other once: 2 (C(7,0) + C(7,1)) / 2^7 = 16 / 128.
    one = [True] * 6 + [False] + [True] * 20
    other = [False] * 6 + [True] + [True] * 20
    assert mcnemar_test(one, other) == 0.125


def test_rank_correlation_by_hand() -> None:
    assert rank_correlation([1, 2, 3], [10, 20, 90]) == pytest.approx(1)
    # Ranks 1, 2.5, 2.5 and 3, 1, 2: covariance -0.75, deviations sqrt(0.75) and 1.
    assert rank_correlation([1, 5, 5], [9, 7, 8]) == pytest.approx(-0.75 / 0.75**0.5)
    assert rank_correlation([1, 2, 3], [0, 0, 0]) is None
    assert rank_correlation([], []) is None


def test_unequal_lengths_are_errors() -> None:
    with pytest.raises(ValueError, match="not paired"):
        rank_correlation([1.0], [])
    with pytest.raises(ValueError, match="not paired"):
        permutation_test([1.0], [])
    with pytest.raises(ValueError, match="not paired"):
        mcnemar_test([True], [])
