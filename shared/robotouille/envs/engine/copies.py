"""Copies of an environment's episodes in the batch engine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robotouille.batch.batch_world import BatchWorld
from robotouille.batch.tables import Ints
from robotouille.envs.rules import EnvRules, InvalidAction
from robotouille.envs.taken import ActionRows, Bools, CopiesTaken, no_such_action
from robotouille.envs.views import Mask, Vector, View, asked_for
from robotouille.errors import SlotOverflowError

__all__ = ["BatchCopies"]


class BatchCopies:
    """Copies of one instance in the batch engine: the same, for sparse rewards, and much faster."""

    def __init__(self, rules: EnvRules, view: View, copies: int) -> None:
        self.view = view
        self.over: Bools = np.ones(copies, dtype=np.bool_)
        self._rules = rules
        self._batch = BatchWorld(self.view.world, copies)
        self._steps: Ints = np.zeros(copies, dtype=np.int64)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self._rules, self.view, self._batch.rows, self._steps, self.over)

    def restore(self, rows: Ints, steps: Ints, over: Bools) -> None:
        """Put all copies where others were."""
        self._batch.rows[:] = rows
        self._steps, self.over = steps.copy(), over.copy()

    def begin(
        self, which: Bools, randoms: Sequence[np.random.Generator], options: dict[str, Any] | None
    ) -> None:
        asked_for((self.view,), options)
        self._batch.reset(which)
        self._steps[which] = 0
        self.over = self.over & ~which

    def take(self, numbers: ActionRows) -> CopiesTaken:
        going = ~self.over
        chosen = self._valid(np.where(going[:, None], numbers, -1))
        before = self._batch.rows.copy()
        _, reached, applied, overflowed = self._batch.step(chosen)
        if overflowed.any():
            for copy in np.flatnonzero(overflowed & going).tolist():
                applied[copy], reached[copy] = self._take_in_world(copy, chosen[copy], before)
        self._steps += going
        terminated = reached & going
        truncated = going & ~terminated & (self._steps >= self._rules.max_steps)
        self.over = ~going | terminated | truncated
        valid = applied.all(axis=1) & going
        return CopiesTaken(terminated.astype(np.float64), terminated, truncated, valid)

    def _valid(self, numbers: ActionRows) -> ActionRows:
        """The actions that are valid now, -1 for the others: what only a player before makes
        possible does not count, as in `Play`."""
        if numbers.min() < 0:
            for copy, seat in np.argwhere((numbers < 0) & ~self.over[:, None]).tolist():
                player, count = self._batch.players[seat], self._batch.action_counts[seat]
                raise no_such_action(player, count, int(numbers[copy, seat]))
        valid = self._batch.valid(numbers)
        if self._rules.invalid is InvalidAction.RAISE:
            for copy, seat in np.argwhere(~valid & ~self.over[:, None]).tolist():
                state, number = self._batch.state(copy), int(numbers[copy, seat])
                raise self.view.inapplicable(state, seat, number)
        return np.where(valid, numbers, -1)

    def _take_in_world(
        self, copy: int, numbers: ActionRows, before: Ints
    ) -> tuple[tuple[bool, ...], bool]:
        """Take a step for which the engine lacked a slot: it may ask for one too many.

        Returns:
            Whose action was applied, and whether the goal is reached.

        Raises:
            SlotOverflowError: There are too few indeed. All copies are where they were before.
        """
        batch = self._batch
        batch.rows[copy], batch.overflowed[copy] = before[copy], False
        chosen = tuple(number if number >= 0 else None for number in numbers.tolist())
        after, applied = self.view.after(batch.state(copy), chosen)
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


def _restored(rules: EnvRules, view: View, rows: Ints, steps: Ints, over: Bools) -> BatchCopies:
    copies = BatchCopies(rules, view, len(rows))
    copies.restore(rows, steps, over)
    return copies
