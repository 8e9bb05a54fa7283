"""Comparison of results of two environments."""

from __future__ import annotations

from typing import Any

import numpy as np


def alike(mine: Any, theirs: Any) -> None:
    """Check that two results of `reset` or `step` are equal, with their types."""
    assert type(mine) is type(theirs)
    if isinstance(mine, np.ndarray):
        assert mine.dtype == theirs.dtype and mine.shape == theirs.shape
        for one, other in zip(mine.tolist(), theirs.tolist(), strict=True):
            assert np.array_equal(one, other)
    elif isinstance(mine, dict):
        assert mine.keys() == theirs.keys()
        for name in mine:
            alike(mine[name], theirs[name])
    elif isinstance(mine, tuple | list):
        for one, other in zip(mine, theirs, strict=True):
            alike(one, other)
    else:
        assert mine == theirs
