"""One episode after the other, by numbers: what all environments have in common."""

from __future__ import annotations

from collections.abc import Sequence
from operator import and_
from typing import Any, NamedTuple

import numpy as np

from robotouille.envs.rewards import StepsToGoPotential
from robotouille.envs.rules import EnvRules, InvalidAction, Observation, Reward
from robotouille.envs.views import Seen, View, asked_for, views_of
from robotouille.errors import RobotouilleError, WrongArgumentError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

__all__ = ["Play", "Taken", "no_such_action"]


class Taken(NamedTuple):
    """What a step came to: the reward, whether the goal was reached or the budget is used up, and
    which player's action was applied."""

    reward: float
    terminated: bool
    truncated: bool
    valid: tuple[bool, ...]


class Play:
    """The course of episodes under an environment's rules.

    `view` is the instance that is played; `steps` are those of this episode, `over` says that it
    has ended, or none has begun.

    Args:
        rules: The environment's.
        views: Those of the rules' instances, where they are known.
    """

    def __init__(self, rules: EnvRules, views: tuple[View, ...] | None = None) -> None:
        self.rules = rules
        self.views = views or views_of(rules.tasks(), rules.slots)
        self.view = self.views[0]
        self.players = self.view.world.players
        self._state: State | None = None
        self._seen: Seen | None = None
        self.steps = 0
        self.over = True
        shaped = rules.reward is Reward.SHAPED
        self._potential = (rules.potential or StepsToGoPotential()) if shaped else None
        self._worth = 0.0

    @property
    def state(self) -> State:
        """The state at present.

        Raises:
            RobotouilleError: No episode has begun.
        """
        if self._state is None:
            raise RobotouilleError("reset the environment: no episode has begun")
        return self._state

    @property
    def seen(self) -> Seen:
        """The arrays of the state at present, which are not to be changed.

        Raises:
            RobotouilleError: No episode has begun.
        """
        if self._seen is None:
            self._seen = self.view.seen(self.state)
        return self._seen

    def observation(self, kind: Observation, players: Sequence[str]) -> Any:
        """What players see at present: an object of their own."""
        if kind is Observation.VECTOR:
            return self.seen.vector.copy()
        return self.view.observation(self.state, kind, players)

    def begin(self, random: np.random.Generator, options: dict[str, Any] | None) -> None:
        """Begin an episode: of the instance that the options ask for, or of one at random.

        Raises:
            WrongArgumentError: The instance is none of this environment's.
        """
        wanted = asked_for(self.views, options)
        if wanted is not None:
            self.view = wanted
        elif len(self.views) > 1:
            self.view = self.views[int(random.integers(len(self.views)))]
        self._state, self._seen = self.view.world.initial, None
        self.steps, self.over = 0, False
        if self._potential is not None:
            self._worth = self._potential(self._state)

    def take(self, numbers: Sequence[int | None]) -> Taken:
        """Take a step in which each player does the action of a number, or nothing (None).

        Raises:
            WrongArgumentError: There is no such number.
            InapplicableError: An action is not valid, and the rules say that this is an error.
            RobotouilleError: No episode has begun, or it is over.
        """
        state = self.state
        if self.over:
            raise RobotouilleError("reset the environment: the episode is over")
        if len(numbers) == 1 and numbers[0] is not None:
            after, valid = self._alone(state, int(numbers[0]))
        else:
            after, valid = self._together(state, numbers)
        seen = self.view.seen(after)
        self._state, self._seen, self.steps = after, seen, self.steps + 1
        terminated = seen.goal_reached
        truncated = not terminated and self.steps >= self.rules.max_steps
        self.over = terminated or truncated
        reward = 1.0 if terminated else 0.0
        if self._potential is not None:
            before, self._worth = self._worth, self._potential(after)
            reward += self.rules.weight * (self.rules.gamma * self._worth - before)
        return Taken(reward, terminated, truncated, valid)

    def _alone(self, state: State, number: int) -> tuple[State, tuple[bool, ...]]:
        action = self._valid(state, 0, number)
        if action is None:
            return state.step(None).state, (False,)
        return self.view.world.successor(state, action), (True,)

    def _together(
        self, state: State, numbers: Sequence[int | None]
    ) -> tuple[State, tuple[bool, ...]]:
        """All at once, in the order of seats: an action may be spoilt by one before it, which is
        no fault of the player, so it is never an error."""
        chosen = [
            None if number is None else self._valid(state, place, int(number))
            for place, number in enumerate(numbers)
        ]
        after, applied = self.view.world.joint_successor(state, chosen)
        wanted = (c is not None or n is None for c, n in zip(chosen, numbers, strict=True))
        return after, tuple(map(and_, applied, wanted))

    def _valid(self, state: State, place: int, number: int) -> GroundAction | None:
        """A player's action of a number, if it is valid now."""
        mask = self.seen.masks[place]
        if not 0 <= number < len(mask):
            raise no_such_action(self.players[place], len(mask), number)
        if mask[number]:
            return self.view.action(state, place, number)
        if self.rules.invalid is InvalidAction.RAISE:
            raise self.view.inapplicable(state, place, number)
        return None


def no_such_action(player: str, count: int, number: int) -> WrongArgumentError:
    """What is raised where a player has no action of a number."""
    return WrongArgumentError(f"{player} has {count} actions, found number {number}")
