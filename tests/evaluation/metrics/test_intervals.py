"""Intervals and tests: worked-out cases, and what holds for any values."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille_evaluation.metrics.intervals import (
    Interval,
    bootstrap,
    mcnemar_test,
    permutation_test,
)
from tests.support.thorough import thorough

VALUES = st.lists(st.floats(-100, 100), min_size=1, max_size=30)
FLAGS = st.lists(st.tuples(st.booleans(), st.booleans()), max_size=30)


def test_an_interval_of_a_hundred_coins() -> None:
    # 47 of 100: the normal approximation is 0.47 ± 1.96 sqrt(0.47 · 0.53 / 100) = 0.372 to 0.568.
    found = bootstrap([[1.0]] * 47 + [[0.0]] * 53)
    assert found is not None
    assert (found.mean, found.count) == (0.47, 100)
    assert found.low == pytest.approx(0.372, abs=0.015)
    assert found.high == pytest.approx(0.568, abs=0.015)


def width(interval: Interval) -> float:
    assert interval.low is not None and interval.high is not None
    return interval.high - interval.low


def test_clusters_widen_an_interval() -> None:
    """Ten alike trials of an instance say no more than one."""
    alike = bootstrap([[float(i % 2)] * 10 for i in range(10)])
    single = bootstrap([[float(i % 2)] for i in range(100)])
    assert alike is not None
    assert single is not None
    assert alike.mean == single.mean == 0.5
    assert width(alike) > 2 * width(single)


def test_without_values() -> None:
    assert bootstrap([]) is None
    assert bootstrap([[], []]) is None


def test_where_all_clusters_are_alike_no_interval_is_known() -> None:
    """One instance with two seeds of which one was won: nothing tells how other instances go."""
    assert bootstrap([[1.0, 0.0]]) == Interval(0.5, None, None, 2)
    assert bootstrap([[0.0, 1.0], [1.0, 0.0]]) == Interval(0.5, None, None, 4)
    assert bootstrap([[3.0], [3.0]]) == Interval(3.0, None, None, 2)
    known = bootstrap([[0.0, 1.0], [1.0, 1.0]])
    assert known is not None and known.low is not None


def test_always_is_not_certainty() -> None:
    # Ten of ten: below 1 - 0.025^(1/10) = 0.3085 of failures (Clopper and Pearson).
    always, never = bootstrap([[1.0]] * 10), bootstrap([[0.0, 0.0]] * 10)
    assert always == Interval(1.0, pytest.approx(1 - 0.3085, abs=1e-4), 1.0, 10)
    assert never == Interval(0.0, 0.0, pytest.approx(0.3085, abs=1e-4), 20)


@thorough(50)
@given(VALUES)
def test_an_interval_holds_its_mean_and_is_the_same_again(values: list[float]) -> None:
    clusters = [[value] for value in values]
    found = bootstrap(clusters, resamples=200)
    assert found == bootstrap(clusters, resamples=200)
    assert found is not None
    if found.low is None or found.high is None:
        assert len({*values}) == 1
    elif {*values} not in ({0.0}, {1.0}):
        assert min(values) - 1e-9 <= found.low <= found.high <= max(values) + 1e-9


def test_a_permutation_test_by_hand() -> None:
    # Differences 1, 2, 3: sums of ±1 ±2 ±3 are as far from 0 as 6 in 2 of 8 ways.
    assert permutation_test([1, 2, 3], [0, 0, 0]) == 2 / 8
    # 1, 1, -1 sum to 1; every way sums to 1 or 3 or their negatives: all 8.
    assert permutation_test([1, 1, 0], [0, 0, 1]) == 1.0
    assert permutation_test([1, 2], [1, 2]) == 1.0


def test_drawn_permutations_are_near_all_of_them() -> None:
    one = [float(i % 5) for i in range(13)]
    other = [float(i % 3) + 0.5 for i in range(13)]
    differences = [a - b for a, b in zip(one, other, strict=True)]
    sums = [
        abs(sum(s * d for s, d in zip(signs, differences, strict=True)))
        for signs in product((1, -1), repeat=13)
    ]
    exact = sum(s >= abs(sum(differences)) - 1e-9 for s in sums) / len(sums)
    assert permutation_test(one, other) == pytest.approx(exact, abs=0.03)


@thorough(50)
@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), max_size=10))
def test_a_permutation_test_takes_no_side(pairs: list[tuple[float, float]]) -> None:
    one, other = [a for a, _ in pairs], [b for _, b in pairs]
    assert permutation_test(one, other) == permutation_test(other, one)
    assert 0 < permutation_test(one, other) <= 1


def test_mcnemar_by_hand() -> None:
    # One alone wins 6 times, the other once: 2 (C(7,0) + C(7,1)) / 2^7 = 16 / 128.
    one = [True] * 6 + [False] + [True] * 20
    other = [False] * 6 + [True] + [True] * 20
    assert mcnemar_test(one, other) == 0.125


@given(FLAGS)
def test_mcnemar_takes_no_side(pairs: list[tuple[bool, bool]]) -> None:
    one, other = [a for a, _ in pairs], [b for _, b in pairs]
    assert mcnemar_test(one, other) == mcnemar_test(other, one)
    assert 0 < mcnemar_test(one, other) <= 1
    assert mcnemar_test(one, one) == 1


def test_what_is_not_paired() -> None:
    with pytest.raises(ValueError, match="not paired"):
        permutation_test([1.0], [])
    with pytest.raises(ValueError, match="not paired"):
        mcnemar_test([True], [])
