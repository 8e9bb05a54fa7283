"""Selection of parameters for every test run; the others are marked as `slow` or `nightly`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import pytest

__all__ = ["quick_sample", "quick_sample_of_pairs", "quick_sample_per_folder"]


def quick_sample(values: Iterable[Any], quick: int = 1, nightly: int | None = None) -> list[Any]:
    """Return a test's parameters. The first `quick` always run; those from number `nightly` only
    run at night.
    """
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


def quick_sample_per_folder(names: Iterable[str]) -> list[Any]:
    """Return task names as parameters; the first of each data set always runs."""
    seen: set[str] = set()
    params = []
    for name in names:
        folder = name.partition("/")[0]
        params.append(pytest.param(name, marks=[pytest.mark.slow] if folder in seen else []))
        seen.add(folder)
    return params


def quick_sample_of_pairs(
    names: Iterable[str], others: Sequence[Any], quick: int | None = None, *, nightly: bool = False
) -> list[Any]:
    """Return all pairs as two parameters. Each name runs once with the other values in turn:
    always, or only the first `quick`. With `nightly`, the other pairs run only at night.
    """
    rest = [pytest.mark.slow, *([pytest.mark.nightly] if nightly else [])]
    params = []
    for i, name in enumerate(names):
        for turn, other in enumerate(others):
            if turn != i % len(others):
                marks = rest
            else:
                marks = [] if quick is None or i < quick else [pytest.mark.slow]
            params.append(pytest.param(name, other, marks=marks))
    return params
