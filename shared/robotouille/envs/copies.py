"""Many copies of an environment's course, stepped together: one by one, or by the batch engine."""

from __future__ import annotations

from collections.abc import Sequence
from operator import and_
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from robotouille.batch.batch_world import BatchWorld
from robotouille.batch.tables import Ints
from robotouille.compiling import COMPILED
from robotouille.envs.play import Play, no_such_action
from robotouille.envs.rules import EnvRules, InvalidAction, Reward
from robotouille.envs.views import Mask, Vector, View, asked_for, views_of
from robotouille.errors import SlotOverflowError

__all__ = ["BatchCopies", "Copies", "CopiesTaken", "PlayedCopies", "copies_of"]

Bools = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.int64]


class CopiesTaken(NamedTuple):
    """What a step came to in each copy: see `Taken`. `valid`: all that was wanted was applied."""

    rewards: npt.NDArray[np.float64]
    terminated: Bools
    truncated: Bools
    valid: Bools


class Copies(Protocol):
    """Copies of one course; `view` is the first instance."""

    view: View

    @property
    def over(self) -> Bools:
        """Whose episode has ended, or has not begun."""

    def begin(
        self, which: Bools, randoms: Sequence[np.random.Generator], options: dict[str, Any] | None
    ) -> None:
        """Begin an episode in some copies: see `Play.begin`."""

    def take(self, numbers: Numbers) -> CopiesTaken:
        """Take a step in each copy that is not over: see `Play.take`.

        Args:
            numbers: That of an action, for each copy and player.
        """

    def vectors(self) -> Vector:
        """The states as numbers, a row for each copy."""

    def masks(self) -> Mask:
        """Which actions are valid, a row for each copy: those of players one behind the other."""


def copies_of(rules: EnvRules, copies: int) -> Copies:
    """Copies under an environment's rules.

    The batch engine does what it can, if it is compiled: of one instance, and where nobody asks
    for the potential of states.
    """
    views = views_of(rules.tasks(), rules.slots)
    if COMPILED and len(views) == 1 and rules.reward is Reward.SPARSE:
        return BatchCopies(rules, views, copies)
    return PlayedCopies(rules, views, copies)


class PlayedCopies:
    """Copies that are played one by one: of any instances, with any reward."""

    def __init__(self, rules: EnvRules, views: tuple[View, ...], copies: int) -> None:
        self.plays = [Play(rules, views) for _ in range(copies)]
        self.view = views[0]

    @property
    def over(self) -> Bools:
        return np.array([play.over for play in self.plays])

    def begin(
        self, which: Bools, randoms: Sequence[np.random.Generator], options: dict[str, Any] | None
    ) -> None:
        for copy in np.flatnonzero(which).tolist():
            self.plays[copy].begin(randoms[copy], options)

    def take(self, numbers: Numbers) -> CopiesTaken:
        rewards = np.zeros(len(self.plays))
        terminated, truncated, valid = np.zeros((3, len(self.plays)), dtype=np.bool_)
        for copy, (play, chosen) in enumerate(zip(self.plays, numbers.tolist(), strict=True)):
            if not play.over:
                rewards[copy], terminated[copy], truncated[copy], applied = play.take(chosen)
                valid[copy] = all(applied)
        return CopiesTaken(rewards, terminated, truncated, valid)

    def vectors(self) -> Vector:
        return np.array([play.seen.vector for play in self.plays])

    def masks(self) -> Mask:
        return np.array([np.concatenate(play.seen.masks) for play in self.plays])


class BatchCopies:
    """Copies of one instance in the batch engine: the same, for sparse rewards, and much faster."""

    def __init__(self, rules: EnvRules, views: tuple[View, ...], copies: int) -> None:
        (self.view,) = views
        self.over: Bools = np.ones(copies, dtype=np.bool_)
        self._rules = rules
        self._batch = BatchWorld(self.view.world, copies)
        self._steps = np.zeros(copies, dtype=np.int64)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self._rules, self.view, self._batch.rows, self._steps, self.over)

    def restore(self, rows: Ints, steps: Numbers, over: Bools) -> None:
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

    def take(self, numbers: Numbers) -> CopiesTaken:
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

    def _valid(self, numbers: Numbers) -> Numbers:
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

    def _take_in_world(self, copy: int, numbers: Numbers, before: Ints) -> tuple[list[bool], bool]:
        """Take a step for which the engine lacked a slot: it may ask for one too many.

        Returns:
            Whose action was applied, and whether the goal is reached.

        Raises:
            SlotOverflowError: There are too few indeed. All copies are where they were before.
        """
        batch, world = self._batch, self.view.world
        batch.rows[copy] = before[copy]
        batch.overflowed[copy] = False
        state = batch.state(copy)
        actions = [
            world.encoding.action(state.facts, player, number) if number >= 0 else None
            for player, number in zip(world.players, numbers.tolist(), strict=True)
        ]
        after, applied = world.joint_successor(state, actions)
        try:
            batch.set_state(copy, after)
        except SlotOverflowError:
            batch.rows[:], batch.overflowed[:] = before, False
            raise
        wanted = [action is not None for action in actions]
        return list(map(and_, applied, wanted)), after.goal_reached

    def vectors(self) -> Vector:
        return self._batch.vectors()

    def masks(self) -> Mask:
        return self._batch.joint_masks().view(np.int8)


def _restored(rules: EnvRules, view: View, rows: Ints, steps: Numbers, over: Bools) -> BatchCopies:
    copies = BatchCopies(rules, (view,), len(rows))
    copies.restore(rows, steps, over)
    return copies
