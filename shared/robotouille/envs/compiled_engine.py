"""Episodes of environments in the batch engine."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from robotouille.batch.batch_world import BatchWorld
from robotouille.batch.single_copy import RuleTables, SingleCopy
from robotouille.batch.tables import Ints
from robotouille.envs.instances import first_state
from robotouille.envs.layout import Layout
from robotouille.envs.rules import (
    NOTHING,
    ActionRows,
    BatchStepResult,
    Bools,
    InvalidAction,
    no_such_action_error,
)
from robotouille.envs.views import (
    Mask,
    Numbers,
    ObservationView,
    StateArrays,
    Vector,
)
from robotouille.errors import SlotOverflowError
from robotouille.world.world import State


class BatchCopies:
    """Copies of one instance in the batch engine: much faster, but only with sparse rewards."""

    def __init__(self, layout: Layout, copies: int) -> None:
        self.layout, self._view, rules = layout, layout.first, layout.rules
        self.over: Bools = np.ones(copies, dtype=np.bool_)
        self._rules = rules
        self._limit = rules.step_limit(self._view.world)
        self._batch = BatchWorld(self._view.world, copies)
        self._steps: Ints = np.zeros(copies, dtype=np.int64)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self.layout, self._batch.rows, self._steps, self.over)

    def restore(self, rows: Ints, steps: Ints, over: Bools) -> None:
        """Set the state of all copies."""
        self._batch.rows[:] = rows
        self._steps, self.over = steps.copy(), over.copy()

    def begin(
        self, which: Bools, randoms: Sequence[np.random.Generator], options: dict[str, Any] | None
    ) -> None:
        self._batch.reset(which)
        for copy in np.flatnonzero(which).tolist() if options or self._rules.endless else ():
            first = first_state(self._rules, (self._view,), self._view, randoms[copy], options)[1]
            self._batch.set_state(copy, first)
        self._steps[which] = 0
        self.over = self.over & ~which

    def take(self, numbers: ActionRows) -> BatchStepResult:
        going = ~self.over
        chosen = self._valid(np.where(going[:, None], numbers, NOTHING))
        before = self._batch.rows.copy()
        _, reached, applied, overflowed = self._batch.step(chosen)
        if overflowed.any():
            for copy in np.flatnonzero(overflowed & going).tolist():
                applied[copy], reached[copy] = self._take_in_world(copy, chosen[copy], before)
        self._steps += going
        terminated = reached & going
        truncated = going & ~terminated & (self._steps >= self._limit)
        self.over = ~going | terminated | truncated
        valid = (applied | (numbers == NOTHING)).all(axis=1) & going
        return BatchStepResult(terminated.astype(np.float64), terminated, truncated, valid)

    def _valid(self, numbers: ActionRows) -> ActionRows:
        """Return the actions that are valid now, and `NOTHING` for the others.

        As in `Play`, an action does not count that only an earlier player makes possible.
        """
        if numbers.min() < NOTHING:
            for copy, seat in np.argwhere((numbers < NOTHING) & ~self.over[:, None]).tolist():
                player, count = self._batch.players[seat], self._batch.action_counts[seat]
                raise no_such_action_error(player, count, int(numbers[copy, seat]))
        valid = self._batch.valid(numbers)
        if self._rules.invalid is InvalidAction.RAISE:
            wrong = ~valid & (numbers != NOTHING) & ~self.over[:, None]
            for copy, seat in np.argwhere(wrong).tolist():
                state, number = self._batch.state(copy), int(numbers[copy, seat])
                raise self._view.inapplicable(state, seat, number)
        return np.where(valid, numbers, NOTHING)

    def _take_in_world(
        self, copy: int, numbers: ActionRows, before: Ints
    ) -> tuple[tuple[bool, ...], bool]:
        """Take a step for which the engine lacks a slot: it may request one too many.

        Returns:
            The players whose action was applied, and whether the goal is reached.

        Raises:
            SlotOverflowError: There are too few slots. All copies stay as they were.
        """
        batch = self._batch
        batch.rows[copy], batch.overflowed[copy] = before[copy], False
        chosen = tuple(number if number >= 0 else None for number in numbers.tolist())
        after, applied = self._view.after(batch.state(copy), chosen)
        try:
            batch.set_state(copy, after)
        except SlotOverflowError:
            batch.rows[:], batch.overflowed[:] = before, False
            raise
        return applied, after.goal_reached

    def vectors(self) -> Vector:
        return self._batch.vectors()

    def masks(self) -> Mask:
        return self._batch.joint_masks().view(np.int8)


def _restored(layout: Layout, rows: Ints, steps: Ints, over: Bools) -> BatchCopies:
    copies = BatchCopies(layout, len(rows))
    copies.restore(rows, steps, over)
    return copies


class BatchRollout:
    """A rollout in the batch engine, which computes `state` on demand."""

    def __init__(self, view: ObservationView, first: State) -> None:
        self._view = view
        counts = view.sizes.actions[: len(view.world.players)]
        ends = np.cumsum([0, *counts]).tolist()
        self._parts = [slice(first, last) for first, last in pairwise(ends)]
        self._copy = SingleCopy(_tables_of(view), ends[:-1])
        self._state = first
        self._since: list[Numbers] = []
        if first is not view.world.initial:
            self._copy.set_state(first)
        self.arrays = self._new_arrays(self._state.goal_reached)

    def __reduce__(self) -> tuple[Any, ...]:
        kept = self._copy.row, self._state, self._since, self.arrays.goal_reached
        return _restored_copy, (self._view, *kept)

    def restore(self, row: Ints, state: State, since: Sequence[Numbers], reached: bool) -> None:
        """Set the engine's row, and the state from which the later steps are replayed."""
        self._copy.row[:] = row
        self._state, self._since = state, list(since)
        self.arrays = self._new_arrays(reached)

    @property
    def state(self) -> State:
        for numbers in self._since:
            self._state, _ = self._view.after(self._state, numbers)
        self._since.clear()
        return self._state

    def take(self, numbers: Numbers) -> tuple[bool, ...]:
        chosen = [NOTHING if number is None else number for number in numbers]
        applied, reached, overflowed = self._copy.step(chosen)
        if overflowed:
            applied, reached = self._take_in_world(numbers)
        else:
            self._since.append(numbers)
        self.arrays = self._new_arrays(reached)
        return applied

    def _take_in_world(self, numbers: Numbers) -> tuple[tuple[bool, ...], bool]:
        """Take a step for which the engine lacks a slot: it may request one too many."""
        before = self.state
        after, applied = self._view.after(before, numbers)
        try:
            self._copy.set_state(after)
        except SlotOverflowError:
            self._copy.set_state(before)
            raise
        self._state = after
        return applied, after.goal_reached

    def _new_arrays(self, reached: bool) -> StateArrays:
        vector = np.zeros(self._view.sizes.vector, dtype=np.float32)
        masks = np.zeros(self._parts[-1].stop, dtype=np.int8)
        self._copy.observe(vector, masks)
        return StateArrays(vector, tuple([masks[part] for part in self._parts]), reached)


def _restored_copy(
    view: ObservationView, row: Ints, state: State, since: Sequence[Numbers], reached: bool
) -> BatchRollout:
    rollout = BatchRollout(view, view.world.initial)
    rollout.restore(row, state, since, reached)
    return rollout


_tables: weakref.WeakKeyDictionary[ObservationView, RuleTables] = weakref.WeakKeyDictionary()


def _tables_of(view: ObservationView) -> RuleTables:
    """Return the rules of an instance, which all its rollouts share."""
    tables = _tables.get(view)
    if tables is None:
        tables = _tables[view] = RuleTables(view.world)
    return tables
