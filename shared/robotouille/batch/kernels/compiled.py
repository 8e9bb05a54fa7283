"""What all kernels of this package need: how they are compiled, and how they read `t`."""

from __future__ import annotations

from pathlib import Path

from robotouille.batch import layout as at
from robotouille.batch.tables import Ints
from robotouille.compiling import compiler, unsigned

__all__ = ["get", "holds", "kernel"]

kernel = compiler(Path(__file__).parents[1], bare=True)
"""The decorator of kernels: the function, compiled if possible. They make no arrays or views."""


@kernel
def get(t: Ints, name: int, i: int) -> int:
    """The i-th number of a list."""
    number: int = t[unsigned(t[unsigned(name)] + i)]
    return number


@kernel
def holds(t: Ints, row: Ints, rule: int) -> bool:
    """Whether all tests of a rule hold."""
    place = t[at.RULE] + get(t, at.RULE_AT, rule)
    for test in range(place + 1, place + 1 + t[unsigned(place)], 3):
        if row[unsigned(t[unsigned(test)])] & t[unsigned(test + 1)] != t[unsigned(test + 2)]:
            return False
    return True
