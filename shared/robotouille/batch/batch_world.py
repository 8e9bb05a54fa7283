"""Many copies of one world at once, as arrays (docs/train.md)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robotouille.batch import layout as at
from robotouille.batch.rules import CompiledRules, refuse_shift
from robotouille.batch.single_copy import row_of, state_of
from robotouille.batch.state_kernels import (
    joint_mask_copies,
    mask_copies,
    random_copies,
    valid_copies,
    vector_copies,
)
from robotouille.batch.step_kernels import first_invalid, step_copies
from robotouille.batch.tables import CopyRange, Ints, initial_row, tables
from robotouille.compiling import warn_if_slow
from robotouille.errors import UnknownNameError, WrongArgumentError
from robotouille.world.world import State, World

Bools = npt.NDArray[np.bool_]

ROOM = 64
"""Numbers kept for each mask to clear it: their count, and up to 63 valid actions."""


class BatchStep(NamedTuple):
    """Result of a step, as arrays with one row for each copy.

    Attributes:
        rewards: 1 if the goal holds after the step, else 0.
        terminated: True if the goal holds after the step.
        applied: True for each player whose action was applied. Other actions were rejected.
        overflowed: True if the copy needed more slots for created objects than there are, in
            this step or earlier.
    """

    rewards: npt.NDArray[np.float32]
    terminated: Bools
    applied: Bools
    overflowed: Bools


class BatchWorld:
    """Copies of a world that take their steps together, all initially in the initial state.

    A step does what `World.step` does, with the players' actions in the order of their seats.
    Only `random_actions` is random. The results depend on the seed and the steps, not on the
    number of threads.

    Args:
        world: The world to copy.
        copies: Number of copies.
        seed: Seed of `random_actions`.
        threads: Number of threads that run compiled kernels.
        auto_reset: Reset a copy that reaches its goal or overflows in the same step.
        slots: Number of created objects of each kind that can exist at once, as in
            `{"water": 8}`. Masks and vectors then follow `encoding` instead of `World.encoding`.

    Attributes:
        encoding: Order of the actions, and layout of the vectors.
        overflowed: True for each copy that needed more slots for created objects than there
            are. Such a copy stands still until it is reset.

    Raises:
        RobotouilleError: The task is a shift.
        WrongArgumentError: `copies` or `threads` is less than 1, or `slots` is invalid.
    """

    def __init__(
        self,
        world: World,
        copies: int,
        *,
        seed: int = 0,
        threads: int = 1,
        auto_reset: bool = False,
        slots: Mapping[str, int] | None = None,
    ) -> None:
        if copies < 1 or threads < 1:
            raise WrongArgumentError(
                f"expected at least 1 copy and 1 thread, found {copies}, {threads}"
            )
        refuse_shift(world)
        warn_if_slow("BatchWorld", 300)
        self.world = world
        self.copies = copies
        self.players = world.players
        self.auto_reset = auto_reset
        self._rules = CompiledRules(world, slots)
        self._tables = tables(self._rules)
        self._initial = initial_row(self._rules, self._tables)
        self.action_counts = tuple(len(actions) for actions in self._rules.actions)
        self._starts = np.cumsum([0, *self.action_counts])
        self.encoding = self._rules.encoding
        self.vector_size = self.encoding.size
        self._rows = np.tile(self._initial, (copies, 1))
        self.overflowed: Bools = np.zeros(copies, dtype=np.bool_)
        self._random = np.random.default_rng(seed)
        bounds = [copies * i // threads for i in range(threads + 1)]
        # Threads get fixed ranges of copies, so results do not depend on their number.
        self._ranges = [(first, last) for first, last in pairwise(bounds) if first < last]
        sizes = len(self._initial), int(self._tables[at.WORK_SIZE]), max(self.action_counts) + 1
        self._scratch = [[np.zeros(n, dtype=np.int64) for n in sizes] for _ in self._ranges]
        self._masks = [
            (np.zeros((copies, count), np.bool_), np.zeros((copies, ROOM), np.int32))
            for count in self.action_counts
        ]
        self._pool = ThreadPoolExecutor(threads) if len(self._ranges) > 1 else None

    @property
    def rows(self) -> Ints:
        """The states, one row for each copy.

        Copy the array to keep the states, and assign the copy to return to them. Kernels do not
        check the rows.

        Raises:
            WrongArgumentError: The assigned value is not an array of this shape and type.
        """
        return self._rows

    @rows.setter
    def rows(self, rows: Ints) -> None:
        own = self._rows
        if (getattr(rows, "shape", None), getattr(rows, "dtype", None)) != (own.shape, own.dtype):
            raise WrongArgumentError(f"expected rows of {own.dtype} {own.shape}")
        self._rows = rows

    def reset(self, mask: npt.ArrayLike | None = None) -> None:
        """Put all copies, or those for which `mask` is true, into the initial state.

        Raises:
            WrongArgumentError: The mask does not have one boolean for each copy.
        """
        chosen = np.ones(self.copies, dtype=np.bool_) if mask is None else np.asarray(mask)
        if chosen.shape != (self.copies,) or chosen.dtype != np.bool_:
            raise WrongArgumentError(
                f"expected {self.copies} booleans, found {chosen.dtype} {chosen.shape}"
            )
        self.rows[chosen] = self._initial
        self.overflowed[chosen] = False

    def step(self, actions: npt.ArrayLike) -> BatchStep:
        """Take a joint action in each copy.

        Args:
            actions: Number of an action for each copy and player, or -1 for no action. With one
                player, the array can have one dimension.

        Raises:
            WrongArgumentError: A number is not one of an action, or the shape is wrong.
        """
        chosen = self._actions(actions)
        applied = np.zeros(chosen.shape, dtype=np.bool_)
        terminated = np.zeros(self.copies, dtype=np.bool_)

        self._run(lambda block: step_copies(
            block, self._initial, chosen, terminated, applied, self.overflowed, self.auto_reset
        ))  # fmt: skip
        overflowed = self.overflowed.copy()
        if self.auto_reset:
            self.overflowed[:] = False
        return BatchStep(terminated.astype(np.float32), terminated, applied, overflowed)

    def _actions(self, actions: npt.ArrayLike) -> npt.NDArray[np.int64]:
        chosen = np.asarray(actions)
        shape = (self.copies, len(self.players))
        alone = shape[1] == 1 and chosen.shape == shape[:1]
        if chosen.dtype.kind not in "iu" or not (alone or chosen.shape == shape):
            raise WrongArgumentError(
                f"expected integers of shape {shape}, found {chosen.dtype} {chosen.shape}"
            )
        chosen = np.ascontiguousarray(chosen.reshape(shape), dtype=np.int64)
        wrong = first_invalid(self._tables, chosen)
        if wrong >= 0:
            copy, seat = divmod(wrong, shape[1])
            raise WrongArgumentError(
                f"{self.players[seat]} has {self.action_counts[seat]} actions, "
                f"found number {chosen[copy, seat]}"
            )
        return chosen

    def masks(self, player: str) -> Bools:
        """Return for each copy which of a player's actions are valid; see `State.mask`.

        The next call for this player changes the returned array. Copy it to keep it, and do not
        write to it.

        Raises:
            UnknownNameError: The task has no such player.
        """
        seat = self._seat(player)
        masks, true = self._masks[seat]
        self._run(lambda block: mask_copies(block, seat, masks, true))
        return masks

    def joint_masks(self) -> Bools:
        """Return the masks of all players side by side, as a new array."""
        starts = self._starts
        masks = np.zeros((self.copies, int(starts[-1])), dtype=np.int8)
        self._run(lambda block: joint_mask_copies(block, masks, starts))
        return masks.view(np.bool_)

    def valid(self, actions: npt.ArrayLike) -> Bools:
        """Return which of these actions are valid now, before any of them is applied.

        Args:
            actions: As for `step`; -1 is not valid.

        Raises:
            WrongArgumentError: A number is not one of an action, or the shape is wrong.
        """
        chosen = self._actions(actions)
        valid = np.zeros(chosen.shape, dtype=np.bool_)
        self._run(lambda block: valid_copies(block, chosen, valid))
        return valid

    def random_actions(self) -> npt.NDArray[np.int64]:
        """Draw a valid action for each copy and player uniformly; -1 if no action is valid."""
        shape = (self.copies, len(self.players))
        # Drawn here because a generator in each kernel would make results depend on the threads.
        draws = self._random.random(shape)
        actions = np.empty(shape, dtype=np.int64)
        self._run(lambda block: random_copies(block, draws, actions))
        return actions

    def vectors(self) -> npt.NDArray[np.float32]:
        """Return the states as vectors; see `State.vector`."""
        vectors = np.zeros((self.copies, self.vector_size), dtype=np.float32)
        self._run(lambda block: vector_copies(block, vectors))
        return vectors

    def state(self, copy: int) -> State:
        """Return the state of a copy as a state of the world.

        Created objects are named after their slots, so their numbers can be lower than in an
        episode that took the same steps.

        Raises:
            WrongArgumentError: The copy has overflowed.
        """
        if self.overflowed[copy]:
            raise WrongArgumentError(f"copy {copy} has overflowed; call reset")
        return state_of(self.rows[copy], self._rules, self._tables)

    def set_state(self, copy: int, state: State) -> None:
        """Put a copy into a state.

        Raises:
            SlotOverflowError: The state has more created objects than there are slots.
            WrongWorldError: The state belongs to another task.
        """
        self.rows[copy] = row_of(state, self._rules, self._tables)
        self.overflowed[copy] = False

    def _seat(self, player: str) -> int:
        try:
            return self.players.index(player)
        except ValueError:
            raise UnknownNameError.player(player, self.players) from None

    def _run(self, kernel: Callable[[CopyRange], None]) -> None:
        """Run a kernel on all copies, split among the threads."""
        blocks = [
            CopyRange(self._tables, self.rows, row, work, found, first, last)
            for (row, work, found), (first, last) in zip(self._scratch, self._ranges, strict=True)
        ]
        if self._pool is None:
            kernel(blocks[0])
            return
        for task in [self._pool.submit(kernel, block) for block in blocks]:
            task.result()
