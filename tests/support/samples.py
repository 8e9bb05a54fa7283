"""A few of many alike tests run after every change; the others are marked as `slow`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import pytest

__all__ = ["each_quickly_once", "first_of_each_folder_quickly", "first_quickly"]


def first_quickly(values: Iterable[Any], quick: int = 1, nightly: int | None = None) -> list[Any]:
    """The values of a test's parameter, tuples for several: the first `quick` run after every
    change, those from number `nightly` on only at night."""
    return [
        pytest.param(
            *(value if isinstance(value, tuple) else (value,)),
            marks=[
                *([pytest.mark.slow] if number >= quick else []),
                *([pytest.mark.nightly] if nightly is not None and number >= nightly else []),
            ],
        )
        for number, value in enumerate(values)
    ]


def first_of_each_folder_quickly(names: Iterable[str]) -> list[Any]:
    """Names of tasks as a test's parameter: the first of each data set runs after every change."""
    seen: set[str] = set()
    params = []
    for name in names:
        folder = name.partition("/")[0]
        params.append(pytest.param(name, marks=[pytest.mark.slow] if folder in seen else []))
        seen.add(folder)
    return params


def each_quickly_once(
    names: Iterable[str], others: Sequence[Any], quick: int | None = None
) -> list[Any]:
    """All pairs as two parameters of a test: after every change each name, or each of the first
    `quick`, runs once, with the others in turn."""
    return [
        pytest.param(
            name,
            other,
            marks=[]
            if turn == i % len(others) and (quick is None or i < quick)
            else pytest.mark.slow,
        )
        for i, name in enumerate(names)
        for turn, other in enumerate(others)
    ]
