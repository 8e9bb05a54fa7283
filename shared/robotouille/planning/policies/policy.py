"""What decides for a seat: policies choose an action in a state.

A policy holds its own copy of the world and whatever memory it has explicitly; it never waits.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from robotouille.planning.policies.script import Did
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

__all__ = ["Policy", "RandomPolicy", "TeamPolicy", "waits"]


class Policy(Protocol):
    """Chooses the actions of one seat."""

    def act(self, state: State) -> GroundAction | None:
        """The action to take in a state; None to do nothing this step."""

    def observe(self, did: Did) -> None:
        """What everybody did in a step; called once for each step before `act`."""


@runtime_checkable
class TeamPolicy(Policy, Protocol):
    """A policy that knows of others in the game, hears what they say, and says something.

    `anticipating` says of the last action that another's in the same step is to make it possible.
    """

    anticipating: bool

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        """Who moves each player now: `bot`, `human`, `model`, `absent` and the like, empty for a
        free seat; and the clock. Called whenever this changes."""

    def hear(self, player: str, text: str) -> None:
        """Something that somebody says in the chat, oneself included."""

    def speak(self) -> list[str]:
        """What there is to be said since this was last asked."""


def waits(policy: Policy) -> bool:
    """Whether a policy that has just decided to do nothing waits for a place or for somebody: as
    its own `waiting` says, if it has that."""
    return bool(getattr(policy, "waiting", False))


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
