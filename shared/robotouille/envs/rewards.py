"""Rewards by potential, which leave the optimal policies what they are.

A. Ng, D. Harada, S. Russell: Policy invariance under reward transformations, ICML 1999: whatever
the potential P, adding `gamma * P(after) - P(before)` to the reward of every step changes no
policy's rank, if the learner discounts by the same gamma and P is a function of the state alone.
"""

from __future__ import annotations

from typing import Any

from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.search_result import Limits
from robotouille.world.world import State, World

__all__ = ["StepsToGoPotential"]

LIMITS = Limits(expansions=2_000)
BEAM_EXPANSIONS = 500

NO_PLAN = -2.0


class StepsToGoPotential:
    """Minus the steps that a planner needs from a state, as a share of those from the first state.

    So it is -1 at first, 0 at the goal, and -2 where it is far away or no plan is found. One
    player's plans are nearly always shortest ones. A state that is met for the first time costs a
    search: some milliseconds for one player, up to a second for a team. What is known is kept;
    environments in one process may share one of these.
    """

    def __init__(self) -> None:
        self._known: dict[State, float] = {}
        self._planners: dict[World, AnytimePlanner] = {}

    def __call__(self, state: State) -> float:
        """The potential of a state."""
        found = self._known.get(state)
        if found is None:
            found = self._known[state] = self._work_out(state)
        return found

    def __deepcopy__(self, memo: dict[int, Any]) -> StepsToGoPotential:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return StepsToGoPotential, ()

    def _work_out(self, state: State) -> float:
        if state.goal_reached:
            return 0.0
        first, left = self._steps(state.world.initial), self._steps(state)
        return NO_PLAN if left is None or first is None else max(NO_PLAN, -left / first)

    def _steps(self, state: State) -> int | None:
        planner = self._planners.get(state.world)
        if planner is None:
            planner = self._planners[state.world] = AnytimePlanner(state.world)
        *_, result = planner.search(state, LIMITS, beam=BEAM_EXPANSIONS)
        return result.length
