"""Steps of many copies, as a kernel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from robotouille.batch.kernels import OVERFLOW, Work, step_copy
from robotouille.batch.tables import Tables
from robotouille.compiling import compiler

__all__ = ["step_copies"]

kernel = compiler(Path(__file__).parent, nogil=True)


@kernel
def step_copies(
    t: Tables,
    rows: npt.NDArray[np.int64],
    work: Work,
    actions: npt.NDArray[np.int64],
    first: int,
    last: int,
    terminated: npt.NDArray[np.bool_],
    applied: npt.NDArray[np.bool_],
    overflowed: npt.NDArray[np.bool_],
    auto_reset: bool,
) -> None:
    """One step of each copy from `first` up to `last`; those that have overflowed stand still."""
    for copy in range(first, last):
        if overflowed[copy]:
            continue
        terminated[copy] = step_copy(t, rows[copy], work, actions[copy], applied[copy])
        if work.flags[OVERFLOW] != 0:
            terminated[copy] = False
            overflowed[copy] = True
        if auto_reset and (terminated[copy] or overflowed[copy]):
            rows[copy] = t.initial
