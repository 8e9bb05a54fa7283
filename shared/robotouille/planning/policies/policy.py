"""Policies, which choose an action in a state.

A policy has its own copy of the world. It is synchronous and keeps all its memory itself.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from robotouille.planning.policies.script import Did
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State


class Policy(Protocol):
    """Interface of objects that choose the actions of one seat."""

    def act(self, state: State) -> GroundAction | None:
        """Return the action to take in a state, or None to do nothing in this step."""

    def observe(self, did: Did) -> None:
        """Process all actions of a step. Called once for each step, before `act`."""


@runtime_checkable
class TeamPolicy(Policy, Protocol):
    """A policy that reacts to the other participants and to chat messages, and sends some itself.

    `anticipating` is true if the last action counts on another seat's action in the same step.
    """

    anticipating: bool

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        """Set the kind of participant in each seat, and the clock. Called on every change.

        Kinds are `bot`, `human`, `model`, `absent` and others, or empty for a free seat.
        """

    def hear(self, player: str, text: str) -> None:
        """Process a chat message. The policy's own messages are included."""

    def speak(self) -> list[str]:
        """Return the new chat messages since the last call."""


def waits(policy: Policy) -> bool:
    """Return whether a policy that chose to do nothing waits for a place or a participant.

    Policies without a `waiting` attribute never wait.
    """
    return bool(getattr(policy, "waiting", False))


class RandomPolicy:
    """Policy that chooses random valid actions. Equal seeds give equal choices."""

    def __init__(self, player: str, seed: int = 0) -> None:
        self._player = player
        self._random = random.Random(f"{seed}:{player}")

    def observe(self, did: Did) -> None:
        pass

    def act(self, state: State) -> GroundAction | None:
        actions = state.actions(self._player)
        return self._random.choice(actions) if actions else None
