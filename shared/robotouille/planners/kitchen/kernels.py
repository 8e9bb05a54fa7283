"""Kernels: functions that are compiled where the extra `fast` is installed, and plain Python else.

A kernel works on integers, on rows of them (`Ints`), and on records: objects of a dataclass all
fields of which are integers or rows, tables or cubes of integers. In plain Python rows are lists
and a record is the object itself. If compiled, rows are arrays of 64-bit integers and a record is a
structure of fixed size, which a kernel gets as one pointer. So the annotation of a row says how
long it may get: `Annotated[Table, 7, 32]`, or `Annotated[Table, SMALL, 7, 32]` if 16 bits are
enough. Kernels read both in the same words: `kitchen.total[process][item]`.

Set ROBOTOUILLE_COMPILE=0 to have plain Python in any case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, MutableSequence, Sequence
from dataclasses import fields
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, cast, get_type_hints

from robotouille.compiling import COMPILED, cache_folder, compiler

__all__ = [
    "COMPILED",
    "SMALL",
    "Cube",
    "Ints",
    "Table",
    "blank_records",
    "grown",
    "ints",
    "kernel",
    "plain",
    "record",
    "records",
    "to_be_compiled",
    "zeros",
]

R = TypeVar("R")
Ints: TypeAlias = MutableSequence[int]
Table: TypeAlias = Sequence[Ints]
Cube: TypeAlias = Sequence[Table]

SMALL = "16 bits"
"""Says in an annotation that a row's integers are below 2¹⁵."""


_numpy: Any = import_module("numpy") if COMPILED else None
_FOLDER = Path(__file__).parent

kernel = compiler(_FOLDER)
"""The decorator of kernels: the function, compiled if possible."""


def to_be_compiled() -> bool:
    """Whether the first search compiles all kernels, which takes a while, because none is
    kept on disk."""
    return COMPILED and next(cache_folder(_FOLDER).glob("**/*.nbi"), None) is None


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


def record(value: R) -> R:
    """A dataclass object for kernels; may be the same object."""
    return records(type(value), [value])[0]


def records(kind: type[R], values: Sequence[R]) -> Sequence[R]:
    """Dataclass objects for kernels; their rows are as long in each as in the others."""
    if not COMPILED:
        return list(values)
    array: Any = _numpy.zeros(len(values), dtype=_structure(cast("Any", kind)))
    for name in array.dtype.names if values else ():
        content = [getattr(value, name) for value in values]
        rows = _numpy.array(content)
        if rows.size:
            array[name][tuple(map(slice, rows.shape))] = rows
    return cast("Sequence[R]", array)


def blank_records(make: Callable[[], R], count: int) -> Sequence[R]:
    """So many dataclass objects for kernels, all zeros; `make` makes one."""
    if not COMPILED:
        return [make() for _ in range(count)]
    return cast("Sequence[R]", _numpy.zeros(count, dtype=_structure(cast("Any", type(make())))))


def plain(kind: type[R], values: Sequence[R]) -> Sequence[R]:
    """Dataclass objects with what kernels left in records, all fields of which are integers."""
    if not COMPILED:
        return values
    return [kind(*row) for row in cast("Any", values).tolist()]


@cache
def _structure(kind: Any) -> Any:
    """The numpy type of a dataclass."""
    hints = get_type_hints(kind, include_extras=True)
    described = []
    for name in (f.name for f in fields(kind)):
        size = getattr(hints[name], "__metadata__", ())
        bits = _numpy.int16 if SMALL in size else _numpy.int64
        described.append((name, bits, tuple(most for most in size if most != SMALL)))
    return _numpy.dtype((_numpy.record, described))
