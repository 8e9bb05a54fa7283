"""Planning for the goals of a team, which may take several steps of the game."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from robotouille.planning.plan import Plan
from robotouille.planning.policies.agenda import Aim
from robotouille.planning.policies.team_plan import (
    Assumption,
    Portion,
    PortionSpentError,
    TeamDecision,
    TeamPlan,
)
from robotouille.world.world import State

Decide = Callable[[Aim], TeamDecision]
"""Returns the decision of a team about one of its goals."""


class Choice(NamedTuple):
    """The plan to follow, and its goal. Without any goal there is only an empty plan."""

    made: TeamPlan
    aim: Aim | None = None


class Deliberation:
    """The choice of a plan for one of several goals, from one state.

    Args:
        base: The state from which to plan.
        aims: The goals, the most urgent one first.
        tried: Number of earlier plans from this state that failed.
        decide: Begins the decision about one goal.
    """

    def __init__(self, base: State, aims: Sequence[Aim], tried: int, decide: Decide) -> None:
        self._decide = decide
        self._left = list(aims)
        self._deciding: TeamDecision | None = None
        self._first: Choice | None = None
        self._nothing = TeamPlan(Plan(()), base, Assumption.NOTHING, can_begin=False)
        self.base = base
        self.tried = tried

    def go_on(self, portion: Portion) -> Choice | None:
        """Return the choice, or None if the portion is too small to finish it."""
        while self._left:
            aim = self._left[0]
            if self._deciding is None:
                self._deciding = self._decide(aim)
            try:
                made = self._deciding.plan(portion)
            except PortionSpentError:
                return None
            self._deciding = None
            del self._left[0]
            # While others keep the team from its first goal, it works for another one.
            if made.can_begin:
                put_off = None if self._first is None else self._first.made
                return Choice(replace(made, instead_of=put_off), aim)
            self._first = self._first or Choice(made, aim)
        return self._first or Choice(self._nothing)
