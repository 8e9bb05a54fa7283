"""Episodes with numbered actions: the common part of all environments."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from operator import index
from typing import Any, Protocol

import numpy as np

from robotouille.envs.instances import first_state
from robotouille.envs.potential import StepsToGoPotential
from robotouille.envs.rules import (
    NOTHING,
    EnvRules,
    InvalidAction,
    Reward,
    StepResult,
    engine_plays,
    no_such_action_error,
    not_reset_error,
)
from robotouille.envs.views import (
    Mask,
    Numbers,
    ObservationView,
    StateArrays,
    views_of,
)
from robotouille.errors import RobotouilleError, WrongArgumentError
from robotouille.world.world import State


class Rollout(Protocol):
    """The states of one episode."""

    @property
    def state(self) -> State:
        """The current state."""

    @property
    def arrays(self) -> StateArrays:
        """Arrays of the current state. Callers must not change them."""

    def take(self, numbers: Numbers) -> tuple[bool, ...]:
        """Take a step of actions that are valid now: see `ObservationView.after`.

        Raises:
            SlotOverflowError: There are too few slots. No step is taken.
        """


class WorldRollout:
    """A rollout in the world, which caches the arrays of known states."""

    def __init__(self, view: ObservationView, first: State) -> None:
        self._view = view
        self.state = first
        self.arrays: StateArrays = view.arrays(self.state)

    def take(self, numbers: Numbers) -> tuple[bool, ...]:
        after, applied = self._view.after(self.state, numbers)
        self.arrays = self._view.arrays(after)
        self.state = after
        return applied


class Play:
    """Episodes under an environment's rules.

    `view` is the current instance and `steps` the steps of this episode. `over` is true if it has
    ended or none has begun.

    Args:
        views: Views of the rules' instances, if known.
    """

    def __init__(self, rules: EnvRules, views: tuple[ObservationView, ...] | None = None) -> None:
        self.rules = rules
        self.views = views or views_of(rules.tasks(), rules.slots)
        self.view = self.views[0]
        self.players = self.view.world.players
        self._rollout: Rollout | None = None
        self._arrays: StateArrays | None = None
        self.steps = 0
        self.over = True
        shaped = rules.reward is Reward.SHAPED
        self._potential = (rules.potential or StepsToGoPotential()) if shaped else None
        self._worth = 0.0
        self._begin: Callable[[ObservationView, State], Rollout] = WorldRollout
        # Several players hardly ever reach a state again, so the world's caches do not help. A
        # single player often does.
        if len(self.players) > 1 and engine_plays(rules, self.view.world):
            from robotouille.envs.compiled_engine import BatchRollout

            self._begin = BatchRollout
            if rules.endless:
                # The engine's tables take up to seconds, for which no reset shall wait.
                for view in self.views:
                    BatchRollout(view, view.world.initial)

    @property
    def state(self) -> State:
        """The current state.

        Raises:
            RobotouilleError: No episode has begun.
        """
        if self._rollout is None:
            raise not_reset_error()
        return self._rollout.state

    @property
    def arrays(self) -> StateArrays:
        """Arrays of the current state. Callers must not change them.

        Raises:
            RobotouilleError: No episode has begun.
        """
        if self._arrays is None:
            raise not_reset_error()
        return self._arrays

    def begin(self, random: np.random.Generator, options: dict[str, Any] | None) -> None:
        """Begin an episode of the requested instance, or of a random one.

        Raises:
            WrongArgumentError: The environment has no such instance or level, or the potential of
                its first state is not finite.
        """
        self.view, first = first_state(self.rules, self.views, self.view, random, options)
        self.players = self.view.world.players
        self._rollout = rollout = self._begin(self.view, first)
        self._arrays = rollout.arrays
        self.steps, self.over = 0, False
        if self._potential is not None:
            self._worth = self._worth_of(rollout.state)

    def take(self, numbers: Sequence[int | None]) -> StepResult:
        """Take a step with a number for each player's action; None or -1 does nothing.

        Raises:
            WrongArgumentError: An action does not exist, or the potential of the next state is not
                finite.
            InapplicableError: An action is not valid, and the rules make that an error.
            RobotouilleError: The episode has ended, or none has begun.
        """
        rollout, arrays = self._rollout, self._arrays
        if rollout is None or arrays is None:
            raise not_reset_error()
        if self.over:
            raise RobotouilleError("reset the environment: the episode has ended")
        wanted = self._valid(arrays.masks, numbers)
        applied = rollout.take(wanted)
        if None in wanted:  # Doing nothing is always applied.
            idle = (number in (None, NOTHING) for number in numbers)
            applied = tuple(a or nothing for a, nothing in zip(applied, idle, strict=True))
        score, arrays = arrays.score, rollout.arrays
        self._arrays = arrays
        self.steps += 1
        terminated = arrays.goal_reached or arrays.over
        truncated = not terminated and self.steps >= self.rules.step_limit(self.view.world)
        self.over = terminated or truncated
        reward = 1.0 if arrays.goal_reached else float(arrays.score - score)
        if self._potential is not None:
            before, self._worth = self._worth, self._worth_of(rollout.state)
            reward += self.rules.weight * (self.rules.gamma * self._worth - before)
        return StepResult(reward, terminated, truncated, applied)

    def _worth_of(self, state: State) -> float:
        worth = self._potential(state) if self._potential is not None else 0.0
        if not math.isfinite(worth):
            raise WrongArgumentError(f"potential: expected a number, found {worth!r}")
        return worth

    def _valid(self, masks: Sequence[Mask], numbers: Sequence[int | None]) -> Numbers:
        """Return the numbers of valid actions, and None for the others."""
        if len(numbers) != len(masks):
            raise WrongArgumentError(f"expected {len(masks)} numbers, found {len(numbers)}")
        if len(masks) == 1:
            return (self._valid_of(0, masks[0], numbers[0]),)
        return tuple(map(self._valid_of, range(len(masks)), masks, numbers))

    def _valid_of(self, place: int, mask: Mask, number: int | None) -> int | None:
        if number is None:
            return None
        try:
            number = index(number)
        except TypeError:
            raise WrongArgumentError(f"expected the number of an action: {number!r}") from None
        if number == NOTHING:
            return None
        if not 0 <= number < len(mask):
            raise no_such_action_error(self.players[place], len(mask), number)
        if mask[number]:
            return number
        if self.rules.invalid is InvalidAction.RAISE:
            raise self.view.inapplicable(self.state, place, number)
        return None
