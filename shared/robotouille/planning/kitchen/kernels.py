"""Kernels: functions that numba compiles if the extra `fast` is installed.

A kernel works on integers, rows of integers (`Ints`) and records. A record is a dataclass object
whose fields are integers or rows, tables or cubes of integers. In plain Python a row is a list and
a record is the object itself. In compiled code a row is an array of 64-bit integers. A record is a
structure of fixed size, which a kernel receives as one pointer. An annotation therefore gives the
maximum length of a row: `Annotated[Table, 7, 32]`, or `Annotated[Table, SMALL, 7, 32]` if 16 bits
are enough. Kernels read both forms with the same code: `kitchen.total[process][item]`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, MutableSequence, Sequence
from dataclasses import fields
from functools import cache
from importlib import import_module
from multiprocessing import parent_process
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, cast, get_type_hints

from robotouille.compiling import COMPILED, cache_folder, compiler
from robotouille.terminal import tell

__all__ = [
    "COMPILED",
    "SMALL",
    "Cube",
    "Ints",
    "Table",
    "announce_compiling",
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

# A record has a fixed size, so each table is as large as the largest kitchen needs. 16 bits instead
# of 64 keep the largest ones (7 * 32 * 63 integers) small.
SMALL = "16 bits"
"""Annotation for rows whose integers are below 2¹⁵."""


_numpy: Any = import_module("numpy") if COMPILED else None
_FOLDER = Path(__file__).parent

kernel = compiler(_FOLDER)
"""Decorator of kernels."""


def to_be_compiled() -> bool:
    """Return whether the first search has to compile all kernels, which takes a while."""
    return COMPILED and next(cache_folder(_FOLDER).glob("**/*.nbi"), None) is None


@cache
def announce_compiling() -> None:
    """Print a line if the next search has to compile the kernels, once for a process.

    A person may wait for it, also in a notebook. Processes that another one started are silent.
    """
    if to_be_compiled() and parent_process() is None:
        words = "compiling the planner, which takes about a minute, once for this installation"
        tell(f"{words} (ROBOTOUILLE_COMPILE=0 turns this off)", err=True)


def ints(values: Iterable[int]) -> Ints:
    """Return a row of integers for kernels."""
    if not COMPILED:
        return list(values)
    array: Ints = _numpy.array(list(values), dtype=_numpy.int64)
    return array


def zeros(size: int) -> Ints:
    """Return a row of `size` zeros for kernels."""
    if not COMPILED:
        return [0] * size
    array: Ints = _numpy.zeros(size, dtype=_numpy.int64)
    return array


def grown(values: Ints, size: int) -> Ints:
    """Return the row extended with zeros to `size`; this may be the same object."""
    if not COMPILED:
        values.extend([0] * (size - len(values)))
        return values
    array: Any = _numpy.zeros(size, dtype=_numpy.int64)
    array[: len(values)] = values
    return cast("Ints", array)


def record(value: R) -> R:
    """Return a dataclass object as a record for kernels; this may be the same object."""
    return records(type(value), [value])[0]


def records(kind: type[R], values: Sequence[R]) -> Sequence[R]:
    """Return dataclass objects as records. Their rows must have equal lengths."""
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
    """Return `count` zeroed records of the dataclass that `make` returns."""
    if not COMPILED:
        return [make() for _ in range(count)]
    return cast("Sequence[R]", _numpy.zeros(count, dtype=_structure(cast("Any", type(make())))))


def plain(kind: type[R], values: Sequence[R]) -> Sequence[R]:
    """Convert records back to dataclass objects. All fields must be integers."""
    if not COMPILED:
        return values
    return [kind(*row) for row in cast("Any", values).tolist()]


@cache
def _structure(kind: Any) -> Any:
    """Return a dataclass as a numpy type."""
    hints = get_type_hints(kind, include_extras=True)
    described = []
    for name in (f.name for f in fields(kind)):
        size = getattr(hints[name], "__metadata__", ())
        bits = _numpy.int16 if SMALL in size else _numpy.int64
        described.append((name, bits, tuple(most for most in size if most != SMALL)))
    return _numpy.dtype((_numpy.record, described))
