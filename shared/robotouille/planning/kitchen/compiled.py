"""Kernels: functions that are compiled where the extra `fast` is installed, and plain Python else.

A kernel works on sequences of integers (`Ints`): arrays of 64-bit integers if compiled, lists if
not. Set ROBOTOUILLE_COMPILE=0 to have plain Python in any case.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, MutableSequence
from typing import Any, TypeAlias, TypeVar

__all__ = ["COMPILED", "Ints", "grown", "ints", "kernel", "zeros"]

F = TypeVar("F", bound=Callable[..., Any])
Ints: TypeAlias = "MutableSequence[int]"

try:
    if os.environ.get("ROBOTOUILLE_COMPILE") == "0":
        raise ImportError
    import numba
    import numpy as np

    COMPILED = True
except ImportError:
    COMPILED = False


def kernel(function: F) -> F:
    """The function, compiled if possible; what is compiled is kept on disk for the next time."""
    if not COMPILED:
        return function
    compiled: F = numba.njit(cache=True, boundscheck=False)(function)
    return compiled


def ints(values: Iterable[int]) -> Ints:
    """A sequence of integers for kernels."""
    if not COMPILED:
        return list(values)
    array: Ints = np.array(list(values), dtype=np.int64)
    return array


def zeros(size: int) -> Ints:
    """So many zeros for kernels."""
    if not COMPILED:
        return [0] * size
    array: Ints = np.zeros(size, dtype=np.int64)
    return array


def grown(values: Ints, size: int) -> Ints:
    """The values with zeros added up to a size; may be the same object."""
    if not COMPILED:
        values.extend([0] * (size - len(values)))
        return values
    array: Ints = np.zeros(size, dtype=np.int64)
    array[: len(values)] = values  # type: ignore[assignment]
    return array
