"""One episode after the other, by numbers: what all environments have in common."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from operator import index
from typing import Any, Protocol

import numpy as np

from robotouille.envs.engine import engine_plays
from robotouille.envs.rewards import StepsToGoPotential
from robotouille.envs.rules import EnvRules, InvalidAction, Observation, Reward
from robotouille.envs.taken import Taken, no_such_action, not_begun
from robotouille.envs.views import Mask, Numbers, Seen, View, asked_for, views_of
from robotouille.errors import RobotouilleError, WrongArgumentError
from robotouille.world.world import State

__all__ = ["Course", "Play", "WorldCourse"]


class Course(Protocol):
    """The states of one episode, from the initial one on."""

    @property
    def state(self) -> State:
        """The state at present."""

    @property
    def seen(self) -> Seen:
        """The arrays of the state at present, which are not to be changed."""

    def take(self, numbers: Numbers) -> tuple[bool, ...]:
        """Take a step of actions that are valid at present: see `View.after`.

        Raises:
            SlotOverflowError: There are too few slots. No step is taken.
        """


class WorldCourse:
    """A course in the world; what was seen in states that were met before is known."""

    def __init__(self, view: View) -> None:
        self._view = view
        self.state: State = view.world.initial
        self.seen: Seen = view.seen(self.state)

    def take(self, numbers: Numbers) -> tuple[bool, ...]:
        after, applied = self._view.after(self.state, numbers)
        self.seen = self._view.seen(after)
        self.state = after
        return applied


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
        self._course: Course | None = None
        self._seen: Seen | None = None
        self.steps = 0
        self.over = True
        shaped = rules.reward is Reward.SHAPED
        self._potential = (rules.potential or StepsToGoPotential()) if shaped else None
        self._worth = 0.0
        self._begin: Callable[[View], Course] = WorldCourse
        if len(self.players) > 1 and engine_plays(rules):
            from robotouille.envs.engine.course import BatchCourse

            self._begin = BatchCourse

    @property
    def state(self) -> State:
        """The state at present.

        Raises:
            RobotouilleError: No episode has begun.
        """
        if self._course is None:
            raise not_begun()
        return self._course.state

    @property
    def seen(self) -> Seen:
        """The arrays of the state at present, which are not to be changed.

        Raises:
            RobotouilleError: No episode has begun.
        """
        if self._seen is None:
            raise not_begun()
        return self._seen

    def observation(self, kind: Observation, players: Sequence[str]) -> Any:
        """What players see at present: an object of their own."""
        if kind is Observation.VECTOR:
            return self.seen.vector.copy()
        return self.view.observation(self.state, kind, players)

    def begin(self, random: np.random.Generator, options: dict[str, Any] | None) -> None:
        """Begin an episode: of the instance that the options ask for, or of one at random.

        Raises:
            WrongArgumentError: The instance is none of this environment's, or the potential of its
                first state is no number.
        """
        wanted = asked_for(self.views, options)
        if wanted is not None:
            self.view = wanted
        elif len(self.views) > 1:
            self.view = self.views[int(random.integers(len(self.views)))]
        self._course = course = self._begin(self.view)
        self._seen = course.seen
        self.steps, self.over = 0, False
        if self._potential is not None:
            self._worth = self._worth_of(course.state)

    def take(self, numbers: Sequence[int | None]) -> Taken:
        """Take a step in which each player does the action of a number, or nothing (None).

        Raises:
            WrongArgumentError: There is no such number, or the potential of the state after it is
                none.
            InapplicableError: An action is not valid, and the rules say that this is an error.
            RobotouilleError: No episode has begun, or it is over.
        """
        course, seen = self._course, self._seen
        if course is None or seen is None:
            raise not_begun()
        if self.over:
            raise RobotouilleError("reset the environment: the episode is over")
        wanted = self._valid(seen.masks, numbers)
        applied = course.take(wanted)
        if None in wanted:  # who wants nothing gets it
            applied = tuple(a or n is None for a, n in zip(applied, numbers, strict=True))
        self._seen = seen = course.seen
        self.steps += 1
        terminated = seen.goal_reached
        truncated = not terminated and self.steps >= self.rules.max_steps
        self.over = terminated or truncated
        reward = 1.0 if terminated else 0.0
        if self._potential is not None:
            before, self._worth = self._worth, self._worth_of(course.state)
            reward += self.rules.weight * (self.rules.gamma * self._worth - before)
        return Taken(reward, terminated, truncated, applied)

    def _worth_of(self, state: State) -> float:
        worth = self._potential(state) if self._potential is not None else 0.0
        if not math.isfinite(worth):
            raise WrongArgumentError(f"potential: expected a number, found {worth!r}")
        return worth

    def _valid(self, masks: Sequence[Mask], numbers: Sequence[int | None]) -> Numbers:
        """The numbers of actions that are valid now, None for the others."""
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
        if not 0 <= number < len(mask):
            raise no_such_action(self.players[place], len(mask), number)
        if mask[number]:
            return number
        if self.rules.invalid is InvalidAction.RAISE:
            raise self.view.inapplicable(self.state, place, number)
        return None
