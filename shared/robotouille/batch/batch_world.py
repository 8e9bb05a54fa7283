"""Many copies of one world at once, as arrays (batch.md)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robotouille.batch import layout as at
from robotouille.batch.kernels.masks import (
    joint_mask_copies,
    mask_copies,
    random_copies,
    valid_copies,
    vector_copies,
)
from robotouille.batch.kernels.steps import first_wrong, step_copies
from robotouille.batch.rows import row_of, state_of
from robotouille.batch.rules import Rules
from robotouille.batch.tables import Ints, initial_row, tables
from robotouille.errors import UnknownNameError, WrongArgumentError, did_you_mean
from robotouille.world.world import State, World

__all__ = ["BatchStep", "BatchWorld"]

Bools = npt.NDArray[np.bool_]

ROOM = 64
"""Numbers kept for each mask, to make it false again."""


class BatchStep(NamedTuple):
    """What became of a step: arrays with a row for each copy.

    `rewards` are 1 where the goal holds after it, else 0; `terminated` says where; `applied` which
    players' actions were applied. What was asked for and not applied was rejected. `overflowed`
    says which copies had more created objects than there are slots, now or before.
    """

    rewards: npt.NDArray[np.float32]
    terminated: Bools
    applied: Bools
    overflowed: Bools


class BatchWorld:
    """Copies of a world, all in their initial state at first.

    Actions, masks and vectors are those of `encoding`, the world's. Steps are `World.step`'s, each
    player's action being applied in the order of their seats. Nothing is random but
    `random_actions`; the same seed and steps give the same, with any number of threads.

    `rows` holds the states, a row for each copy: copy it to keep them, and assign to it to go back.
    `overflowed` says which copies stand still until they are reset, since they had more created
    objects than there are slots.

    Args:
        world: Whose copies they are.
        copies: How many.
        seed: Of `random_actions`.
        threads: In how many threads kernels run, if they are compiled.
        auto_reset: Whether a copy that reaches its goal or overflows is reset in the same step.
        slots: How many created objects of a kind there may be at once, as in `{"water": 8}`; masks
            and vectors are not those of `World.encoding` then, but of `encoding`.

    Raises:
        RobotouilleError: There are slots for what cannot be created.
        WrongArgumentError: There is to be no copy, or no thread.
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
            raise WrongArgumentError(f"expected a copy and a thread at least: {copies}, {threads}")
        self.world = world
        self.copies = copies
        self.players = world.players
        self.auto_reset = auto_reset
        self._rules = Rules(world, slots)
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
        self._ranges = [(first, last) for first, last in pairwise(bounds) if first < last]
        self._work = self._room(int(self._tables[at.WORK_SIZE]))
        self._row = self._room(len(self._initial))
        self._found = self._room(max(self.action_counts) + 1)
        self._masks = [
            (np.zeros((copies, count), np.bool_), np.zeros((copies, ROOM), np.int32))
            for count in self.action_counts
        ]
        self._pool = ThreadPoolExecutor(threads) if len(self._ranges) > 1 else None

    @property
    def rows(self) -> Ints:
        """The states, a row for each copy; kernels trust what is in them.

        Raises:
            WrongArgumentError: What is assigned is no array of this shape.
        """
        return self._rows

    @rows.setter
    def rows(self, rows: Ints) -> None:
        own = self._rows
        if (getattr(rows, "shape", None), getattr(rows, "dtype", None)) != (own.shape, own.dtype):
            raise WrongArgumentError(f"expected rows of {own.dtype} {own.shape}")
        self._rows = rows

    def reset(self, mask: npt.ArrayLike | None = None) -> None:
        """Put copies into the initial state: all, or those of which `mask` is true.

        Raises:
            WrongArgumentError: The mask has not one truth value for each copy.
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
            actions: For each copy and player the number of an action, or -1 for nothing; with one
                player, one number for each copy will do.

        Raises:
            WrongArgumentError: There is no such number, or not one for each copy and player.
        """
        chosen = self._actions(actions)
        applied = np.zeros(chosen.shape, dtype=np.bool_)
        terminated = np.zeros(self.copies, dtype=np.bool_)

        def work(part: int, first: int, last: int) -> None:
            step_copies(
                self._tables,
                self.rows,
                self._initial,
                self._row[part],
                self._work[part],
                chosen,
                first,
                last,
                terminated,
                applied,
                self.overflowed,
                self.auto_reset,
            )

        self._run(work)
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
        wrong = first_wrong(self._tables, chosen)
        if wrong >= 0:
            copy, seat = divmod(wrong, shape[1])
            raise WrongArgumentError(
                f"{self.players[seat]} has {self.action_counts[seat]} actions, "
                f"found number {chosen[copy, seat]}"
            )
        return chosen

    def masks(self, player: str) -> Bools:
        """Which of a player's actions are valid, for each copy: see `State.mask`.

        The array is the batch's own: the next call for that player changes it. Copy it to keep it,
        and do not write on it.

        Raises:
            UnknownNameError: There is no such player.
        """
        seat = self._seat(player)
        masks, true = self._masks[seat]

        def work(part: int, first: int, last: int) -> None:
            states = self._tables, self.rows, self._row[part], self._work[part]
            mask_copies(*states, seat, first, last, masks, true, self._found[part])

        self._run(work)
        return masks

    def joint_masks(self) -> Bools:
        """The masks of all players, one behind the other, for each copy: a new array."""
        starts = self._starts
        masks = np.zeros((self.copies, int(starts[-1])), dtype=np.int8)

        def work(part: int, first: int, last: int) -> None:
            states = self._tables, self.rows, self._row[part], self._work[part]
            joint_mask_copies(*states, first, last, masks, starts, self._found[part])

        self._run(work)
        return masks.view(np.bool_)

    def valid(self, actions: npt.ArrayLike) -> Bools:
        """Which of these actions are valid now, before any of them is applied.

        Args:
            actions: As for `step`; -1 is not valid.

        Raises:
            WrongArgumentError: There is no such number, or not one for each copy and player.
        """
        chosen = self._actions(actions)
        valid = np.zeros(chosen.shape, dtype=np.bool_)
        self._run(lambda part, first, last: valid_copies(
            self._tables, self.rows, self._row[part], chosen, first, last, valid
        ))  # fmt: skip
        return valid

    def random_actions(self) -> npt.NDArray[np.int64]:
        """A valid action of each player in each copy, all as likely; -1 where there is none."""
        shape = (self.copies, len(self.players))
        draws = self._random.random(shape)
        actions = np.empty(shape, dtype=np.int64)

        def work(part: int, first: int, last: int) -> None:
            states = self._tables, self.rows, self._row[part], self._work[part]
            random_copies(*states, draws, first, last, actions, self._found[part])

        self._run(work)
        return actions

    def vectors(self) -> npt.NDArray[np.float32]:
        """The states as numbers, for each copy: see `State.vector`."""
        vectors = np.zeros((self.copies, self.vector_size), dtype=np.float32)
        self._run(lambda _, first, last: vector_copies(
            self._tables, self.rows, first, last, vectors
        ))  # fmt: skip
        return vectors

    def state(self, copy: int) -> State:
        """The state of a copy, as one of the world's: to look at, show or plan from.

        Created objects are called by the slots that they stand in, so their numbers may be lower
        than on the course of play that led there.

        Raises:
            WrongArgumentError: The copy has overflowed, and has no state.
        """
        if self.overflowed[copy]:
            raise WrongArgumentError(f"copy {copy} has overflowed: reset it")
        return state_of(self.rows[copy], self._rules, self._tables)

    def set_state(self, copy: int, state: State) -> None:
        """Put a copy into a state.

        Raises:
            SlotOverflowError: It has more created objects than there are slots.
            WrongWorldError: It is one of another task.
        """
        self.rows[copy] = row_of(state, self._rules, self._tables)
        self.overflowed[copy] = False

    def _room(self, size: int) -> list[Ints]:
        """Arrays to write on, one for each thread."""
        return [np.zeros(size, dtype=np.int64) for _ in self._ranges]

    def _seat(self, player: str) -> int:
        try:
            return self.players.index(player)
        except ValueError:
            near = did_you_mean(player, self.players)
            raise UnknownNameError(f"no player {player!r}{near}") from None

    def _run(self, work: Callable[[int, int, int], None]) -> None:
        """Have each thread do its part of the copies."""
        if self._pool is None:
            for part, (first, last) in enumerate(self._ranges):
                work(part, first, last)
            return
        tasks = [
            self._pool.submit(work, part, first, last)
            for part, (first, last) in enumerate(self._ranges)
        ]
        for task in tasks:
            task.result()
