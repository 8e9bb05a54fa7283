"""The potential of shaped rewards: steps to go."""

from __future__ import annotations

from typing import Any

from robotouille.planning.plan import Limits
from robotouille.planning.solvers import AnytimePlanner
from robotouille.world.world import State, World

LIMITS = Limits(expansions=2_000)
BEAM_EXPANSIONS = 500

NO_PLAN = -2.0


class StepsToGoPotential:
    """Negative steps to go from a state, divided by the steps from the initial state.

    The potential is -1 at first and 0 at the goal. It is -2 for states that are far away or without
    a plan. Plans for one player are almost always shortest plans. Each new state costs a search:
    some milliseconds for one player, up to a second for a team. Results are cached, and
    environments in one process may share one object.
    """

    def __init__(self) -> None:
        self._known: dict[State, float] = {}
        self._planners: dict[World, AnytimePlanner] = {}

    def __call__(self, state: State) -> float:
        """Return the potential of a state."""
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
