"""What decides for a seat: policies choose an action in a state.

A policy holds its own copy of the world and whatever memory it has explicitly; it never waits.
"""

from __future__ import annotations

import random
from typing import Protocol

from robotouille.planning.policies.script import Did
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

__all__ = ["Policy", "RandomPolicy"]


class Policy(Protocol):
    """Chooses the actions of one seat."""

    def act(self, state: State) -> GroundAction | None:
        """The action to take in a state; None to do nothing this step."""

    def observe(self, did: Did) -> None:
        """What everybody did in a step; called once for each step before `act`."""


class RandomPolicy:
    """A valid action at random; one seed, one course."""

    def __init__(self, player: str, seed: int = 0) -> None:
        self._player = player
        self._random = random.Random(f"{seed}:{player}")

    def observe(self, did: Did) -> None:
        pass

    def act(self, state: State) -> GroundAction | None:
        actions = state.actions(self._player)
        return self._random.choice(actions) if actions else None
