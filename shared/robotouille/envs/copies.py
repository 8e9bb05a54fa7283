"""Copies of an environment's episodes, stepped together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from robotouille.envs.play import Play
from robotouille.envs.rules import EnvRules
from robotouille.envs.taken import ActionRows, Bools, CopiesTaken
from robotouille.envs.views import Mask, Vector, View

__all__ = ["Copies", "PlayedCopies"]


class Copies(Protocol):
    """Copies of an environment's episodes; `view` is the first instance."""

    view: View

    @property
    def over(self) -> Bools:
        """Whose episode has ended, or has not begun."""

    def begin(
        self, which: Bools, randoms: Sequence[np.random.Generator], options: dict[str, Any] | None
    ) -> None:
        """Begin an episode in some copies: see `Play.begin`."""

    def take(self, numbers: ActionRows) -> CopiesTaken:
        """Take a step in each copy that is not over: see `Play.take`.

        Raises:
            SlotOverflowError: There are too few slots in some copy.
        """

    def vectors(self) -> Vector:
        """The states as numbers, a row for each copy."""

    def masks(self) -> Mask:
        """Which actions are valid, a row for each copy: those of players one behind the other."""


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

    def take(self, numbers: ActionRows) -> CopiesTaken:
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
