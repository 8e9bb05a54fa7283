"""One episode after the other, by numbers: what all environments have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from robotouille.domain.task import Task
from robotouille.envs.rewards import StepsToGoPotential
from robotouille.envs.rules import EnvRules, InvalidAction, Reward
from robotouille.envs.views import View, views_of
from robotouille.errors import InapplicableError, RobotouilleError, WrongArgumentError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State

__all__ = ["Play", "Taken"]


class Taken(NamedTuple):
    """What a step came to: the reward, whether the goal was reached or the budget is used up, and
    which player's action was applied."""

    reward: float
    terminated: bool
    truncated: bool
    valid: tuple[bool, ...]


class Play:
    """The course of episodes under an environment's rules.

    `view` is the instance that is played, `state` the state, None before the first episode;
    `steps` are those of this episode.
    """

    def __init__(self, rules: EnvRules) -> None:
        self.rules = rules
        self.views = views_of(rules.tasks(), rules.slots)
        self.view = self.views[0]
        self.players = self.view.world.players
        self.state: State | None = None
        self.steps = 0
        self.over = False
        shaped = rules.reward is Reward.SHAPED
        self._potential = (rules.potential or StepsToGoPotential()) if shaped else None
        self._worth = 0.0

    def begin(self, random: np.random.Generator, options: dict[str, Any] | None) -> State:
        """Begin an episode: of the instance that the options ask for, or of one at random.

        Raises:
            WrongArgumentError: The instance is none of this environment's.
        """
        wanted = (options or {}).get("instance")
        if wanted is not None:
            self.view = self._instance(wanted)
        elif len(self.views) > 1:
            self.view = self.views[int(random.integers(len(self.views)))]
        self.state, self.steps, self.over = self.view.world.initial, 0, False
        if self._potential is not None:
            self._worth = self._potential(self.state)
        return self.state

    def _instance(self, wanted: object) -> View:
        """An instance by its task, its name, or its number."""
        for number, view in enumerate(self.views):
            task = view.world.task
            if wanted in (number, task.name) or (isinstance(wanted, Task) and wanted == task):
                return view
        names = ", ".join(view.world.task.name for view in self.views)
        raise WrongArgumentError(f"instance: expected one of {names}, found {wanted!r}")

    def take(self, numbers: Sequence[int | None]) -> Taken:
        """Take a step in which each player does the action of a number, or nothing (None).

        Raises:
            WrongArgumentError: There is no such number.
            InapplicableError: An action is not valid, and the rules say that this is an error.
            RobotouilleError: No episode has begun, or it is over.
        """
        state = self.state
        if state is None or self.over:
            raise RobotouilleError("reset the environment: " + ("over" if state else "not begun"))
        if len(numbers) == 1 and numbers[0] is not None:
            after, valid = self._alone(state, numbers[0])
        else:
            after, valid = self._together(state, numbers)
        self.state, self.steps = after, self.steps + 1
        terminated = self.view.seen(after).goal_reached
        truncated = not terminated and self.steps >= self.rules.max_steps
        self.over = terminated or truncated
        reward = 1.0 if terminated else 0.0
        if self._potential is not None:
            before, self._worth = self._worth, self._potential(after)
            gain = self.rules.gamma * self._worth - before
            reward += self.rules.weight * gain
        return Taken(reward, terminated, truncated, valid)

    def _action(self, state: State, place: int, number: int) -> GroundAction | None:
        """The action of a number; None for one that this instance, or its state, has not."""
        size = self.view.sizes.actions[place]
        if not 0 <= number < size:
            raise WrongArgumentError(
                f"{self.players[place]} has {size} actions, found number {number}"
            )
        world, player = self.view.world, self.players[place]
        if number >= len(world.ground_actions(player)):
            return None
        return state.action(player, int(number))

    def _alone(self, state: State, number: int) -> tuple[State, tuple[bool, ...]]:
        action = self._action(state, 0, number)
        world = self.view.world
        if action is not None and world.applicable(state, action):
            return world.successor(state, action), (True,)
        self._refuse(state, action)
        return state.step(None).state, (False,)

    def _together(
        self, state: State, numbers: Sequence[int | None]
    ) -> tuple[State, tuple[bool, ...]]:
        """All at once, in the order of seats: an action may be spoilt by one before it, which is
        no fault of the player, so it is never an error."""
        chosen: list[GroundAction | None] = []
        valid = []
        for place, number in enumerate(numbers):
            action = None if number is None else self._action(state, place, int(number))
            fine = action is not None and self.view.world.applicable(state, action)
            if not fine and number is not None:
                self._refuse(state, action)
            chosen.append(action if fine else None)
            valid.append(fine or number is None)
        step = state.step(chosen)
        attempts = iter(step.attempts)
        for place, action in enumerate(chosen):
            if action is not None:
                valid[place] = next(attempts).applied
        return step.state, tuple(valid)

    def _refuse(self, state: State, action: GroundAction | None) -> None:
        if self.rules.invalid is InvalidAction.RAISE:
            if action is None:
                unmet = (Unmet(UnmetKind.MISSING, "its object does not exist"),)
                raise InapplicableError("this number's action", unmet)
            raise InapplicableError(action.sentence, self.view.world.unmet(state, action))
