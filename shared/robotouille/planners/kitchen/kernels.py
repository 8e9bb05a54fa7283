"""Kernels: functions that are compiled where the extra `fast` is installed, and plain Python else.

A kernel works on sequences of integers (`Ints`): arrays of 64-bit integers if compiled, lists if
not. Set ROBOTOUILLE_COMPILE=0 to have plain Python in any case.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, MutableSequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, cast

__all__ = ["COMPILED", "Ints", "grown", "ints", "kernel", "zeros"]

F = TypeVar("F", bound=Callable[..., Any])
Ints: TypeAlias = "MutableSequence[int]"


def _module(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        return None


_numba: Any = None if os.environ.get("ROBOTOUILLE_COMPILE") == "0" else _module("numba")
_numpy: Any = None if _numba is None else _module("numpy")

COMPILED = _numba is not None
"""Whether kernels are compiled."""


def kernel(function: F) -> F:
    """The function, compiled if possible; what is compiled is kept on disk for the next time."""
    if not COMPILED:
        return function
    before = _numba.config.CACHE_DIR
    _numba.config.CACHE_DIR = str(_cache_folder())
    try:
        compiled: F = _numba.njit(cache=True)(function)
    finally:
        _numba.config.CACHE_DIR = before
    return compiled


@cache
def _cache_folder() -> Path:
    """Where compiled kernels are kept: a folder for each version of their source, since a kernel
    contains those it calls."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    source = b"".join(p.read_bytes() for p in sorted(Path(__file__).parent.rglob("*.py")))
    return Path(home) / "robotouille" / hashlib.blake2b(source, digest_size=8).hexdigest()


def ints(values: Iterable[int]) -> Ints:
    """A sequence of integers for kernels."""
    if not COMPILED:
        return list(values)
    array: Ints = _numpy.array(list(values), dtype=_numpy.int64)
    return array


def zeros(size: int) -> Ints:
    """So many zeros for kernels."""
    if not COMPILED:
        return [0] * size
    array: Ints = _numpy.zeros(size, dtype=_numpy.int64)
    return array


def grown(values: Ints, size: int) -> Ints:
    """The values with zeros added up to a size; may be the same object."""
    if not COMPILED:
        values.extend([0] * (size - len(values)))
        return values
    array: Any = _numpy.zeros(size, dtype=_numpy.int64)
    array[: len(values)] = values
    return cast("Ints", array)
