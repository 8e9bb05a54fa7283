"""An episode in the batch engine."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from robotouille.batch.single_copy import RuleTables, SingleCopy
from robotouille.batch.tables import Ints
from robotouille.envs.views import Numbers, Seen, View
from robotouille.errors import SlotOverflowError
from robotouille.world.world import State

__all__ = ["BatchCourse"]


class BatchCourse:
    """A course in the batch engine, where a step takes no longer if nobody has been there before:
    several players hardly ever come to a state again. `state` is worked out when asked for."""

    def __init__(self, view: View) -> None:
        self._view = view
        ends = np.cumsum([0, *view.sizes.actions]).tolist()
        self._parts = [slice(first, last) for first, last in pairwise(ends)]
        self._copy = SingleCopy(_tables_of(view), ends[:-1])
        self._state = view.world.initial
        self._since: list[Numbers] = []
        self.seen = self._look(self._state.goal_reached)

    def __reduce__(self) -> tuple[Any, ...]:
        kept = self._copy.row, self._state, self._since, self.seen.goal_reached
        return _restored, (self._view, *kept)

    def restore(self, row: Ints, state: State, since: Sequence[Numbers], reached: bool) -> None:
        """Go where another course was: its row, and a state with the steps taken since."""
        self._copy.row[:] = row
        self._state, self._since = state, list(since)
        self.seen = self._look(reached)

    @property
    def state(self) -> State:
        for numbers in self._since:
            self._state, _ = self._view.after(self._state, numbers)
        self._since.clear()
        return self._state

    def take(self, numbers: Numbers) -> tuple[bool, ...]:
        chosen = [-1 if number is None else number for number in numbers]
        applied, reached, overflowed = self._copy.step(chosen)
        if overflowed:
            applied, reached = self._take_in_world(numbers)
        else:
            self._since.append(numbers)
        self.seen = self._look(reached)
        return applied

    def _take_in_world(self, numbers: Numbers) -> tuple[tuple[bool, ...], bool]:
        """Take a step for which the engine lacked a slot: it may ask for one too many."""
        before = self.state
        after, applied = self._view.after(before, numbers)
        try:
            self._copy.set_state(after)
        except SlotOverflowError:
            self._copy.set_state(before)
            raise
        self._state = after
        return applied, after.goal_reached

    def _look(self, reached: bool) -> Seen:
        vector = np.zeros(self._view.sizes.vector, dtype=np.float32)
        masks = np.zeros(self._parts[-1].stop, dtype=np.int8)
        self._copy.look(vector, masks)
        return Seen(vector, tuple([masks[part] for part in self._parts]), reached)


def _restored(
    view: View, row: Ints, state: State, since: Sequence[Numbers], reached: bool
) -> BatchCourse:
    course = BatchCourse(view)
    course.restore(row, state, since, reached)
    return course


_tables: weakref.WeakKeyDictionary[View, RuleTables] = weakref.WeakKeyDictionary()


def _tables_of(view: View) -> RuleTables:
    """The rules of an instance, which all its courses share."""
    tables = _tables.get(view)
    if tables is None:
        tables = _tables[view] = RuleTables(view.world)
    return tables
