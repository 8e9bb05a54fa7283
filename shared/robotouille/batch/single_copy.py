"""One copy of a world in the engine, for those who play one game at a time."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from robotouille.batch import layout as at
from robotouille.batch.kernels.masks import look_copies
from robotouille.batch.kernels.steps import step_copies
from robotouille.batch.rows import row_of
from robotouille.batch.rules import Rules
from robotouille.batch.tables import initial_row, tables
from robotouille.world.world import State, World

__all__ = ["RuleTables", "SingleCopy"]


class _Scratch(threading.local):
    """What kernels write on meanwhile: each thread has its own, since kernels run side by side."""

    def __init__(self, row: int, work: int, found: int) -> None:
        self.row, self.work, self.found = (np.zeros(n, dtype=np.int64) for n in (row, work, found))


class RuleTables:
    """A world's rules as kernels read them, which takes up to a second to work out. All copies of
    the world may share one."""

    def __init__(self, world: World) -> None:
        self.rules = Rules(world)
        self.numbers = tables(self.rules)
        self.initial = initial_row(self.rules, self.numbers)
        most = max(len(actions) for actions in self.rules.actions)
        self.scratch = _Scratch(len(self.initial), int(self.numbers[at.WORK_SIZE]), most + 1)


class SingleCopy:
    """A world's state as a row, in its initial state at first. It does what `BatchWorld` does with
    one copy, without what that spends on arrays. `row` is the state: copy it to keep it.

    Args:
        rule_tables: The world's.
        starts: Where in an array of all masks that of each player begins.
    """

    def __init__(self, rule_tables: RuleTables, starts: Sequence[int]) -> None:
        self._shared = rule_tables
        self._rows = rule_tables.initial[None].copy()
        self.row = self._rows[0]
        self._starts = np.array(starts, dtype=np.int64)
        self._actions = np.zeros((1, len(starts)), dtype=np.int64)
        self._applied = np.zeros((1, len(starts)), dtype=np.bool_)
        self._ends = np.zeros((2, 1), dtype=np.bool_)
        self._reached, self._overflowed = self._ends

    def set_state(self, state: State) -> None:
        """Go to a state.

        Raises:
            SlotOverflowError: It has more created objects than there are slots.
        """
        self.row[:] = row_of(state, self._shared.rules, self._shared.numbers)

    def step(self, numbers: Sequence[int]) -> tuple[tuple[bool, ...], bool, bool]:
        """Take a joint action.

        Args:
            numbers: Of an action of each player, or -1 for nothing. Nobody looks whether there are
                such actions.

        Returns:
            Whose action was applied, whether the goal is reached, and whether a slot was missing:
            then the copy has to be put into another state.
        """
        shared, scratch = self._shared, self._shared.scratch
        for player, number in enumerate(numbers):
            self._actions[0, player] = number
        self._overflowed[0] = False
        step_copies(
            shared.numbers,
            self._rows,
            shared.initial,
            scratch.row,
            scratch.work,
            self._actions,
            0,
            1,
            self._reached,
            self._applied,
            self._overflowed,
            False,
        )
        (reached,), (overflowed,) = self._ends.tolist()
        return tuple(self._applied[0].tolist()), reached, overflowed

    def look(self, vector: npt.NDArray[np.float32], masks: npt.NDArray[np.int8]) -> None:
        """Write the state as numbers and which actions are valid into arrays of zeros: see
        `State.vector` and `State.mask`."""
        shared, scratch = self._shared, self._shared.scratch
        look_copies(
            shared.numbers,
            self._rows,
            scratch.row,
            scratch.work,
            0,
            1,
            vector[None],
            masks[None],
            self._starts,
            scratch.found,
        )
