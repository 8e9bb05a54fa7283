"""What all kernels of this package need: how they are compiled, and how they read lists of `t`."""

from __future__ import annotations

from pathlib import Path

from robotouille.batch.tables import Ints
from robotouille.compiling import compiler

__all__ = ["get", "kernel"]

kernel = compiler(Path(__file__).parent, nogil=True)
"""The decorator of kernels: the function, compiled if possible; other threads run meanwhile."""


@kernel
def get(t: Ints, name: int, i: int) -> int:
    """The i-th number of a list."""
    number: int = t[t[name] + i]
    return number
