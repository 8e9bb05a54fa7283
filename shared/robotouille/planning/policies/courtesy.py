"""Favours that a planner bot does for participants on request."""

from __future__ import annotations

from collections.abc import Callable

from robotouille.planning.policies.aside import after, held_by, put_down
from robotouille.planning.policies.standing import standing_at
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.signals import Intent, Signal
from robotouille.world.scene import scene
from robotouille.world.world import State

YIELDING = 4
"""Steps for which a seat stays away from a station that it left on request."""

PAUSING = 10
"""Steps for which a seat does nothing after `wait`."""

GIVING, GIVEN = 15, 25
"""Steps in which a seat puts down a needed item, and for which it leaves the item alone."""


class Courtesy:
    """Favours of one seat.

    Args:
        step_aside: Returns a walk to an empty place, or None.
    """

    def __init__(self, player: str, step_aside: Callable[[State], GroundAction | None]) -> None:
        self._player = player
        self._step_aside = step_aside
        self._yielding = self._pausing = self._giving = 0
        self._given, self._given_until = "", 0

    def asked(self, signal: Signal, state: State, step: int) -> None:
        """Process a signal of a participant outside the team."""
        intent, target = signal
        if intent is Intent.WAIT and target in ("", self._player):
            self._pausing = step + PAUSING
        elif intent is Intent.YOURS:
            self._yielding = self._pausing = self._giving = 0
        elif intent is Intent.NEED and _place(target, state) == standing_at(state, self._player):
            self._yielding = step + YIELDING
        elif intent is Intent.NEED and target in held_by(state, self._player):
            self._giving = step + GIVING
            self._given, self._given_until = target, step + GIVING + GIVEN

    def at_work(self, step: int) -> bool:
        """Return whether the seat does something for others instead of its plan."""
        return max(self._yielding, self._pausing, self._giving) > step

    def act(self, state: State, step: int) -> GroundAction | None:
        """Return the next action for others, or None to do nothing."""
        if self._giving > step:
            if self._holds_given(state):
                way = put_down(state, self._player)
                if not way:
                    self._giving = 0  # There is no empty place.
                return way[0] if way else None
            # The other participant can now come to the station where it lies.
            self._giving, self._yielding = 0, step + YIELDING
            self._given_until = step + GIVEN
        return self._step_aside(state) if self._yielding > step else None

    def _holds_given(self, state: State) -> bool:
        placed = scene(state).get(self._given)
        return placed is not None and placed.host == self._player

    def refrains(self, action: GroundAction, state: State, step: int) -> bool:
        """Return whether an action takes back, or leads to, what the seat has handed over."""
        if step >= self._given_until or self._holds_given(state):
            return False
        placed = scene(state).get(self._given)
        if placed is not None and action.destination is not None:
            return action.destination == placed.host
        return self._given in action.arguments and self._holds_given(after(state, action))


def _place(target: str, state: State) -> str | None:
    """Return a station, or the station on which an object lies."""
    placed = scene(state).get(target)
    return target if placed is None or placed.host is None else placed.host
