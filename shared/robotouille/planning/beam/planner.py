"""Plans for one player or a team, from any state: better ones the more may be expanded.

planner = BeamPlanner(world)
solution = planner.solve(world.initial)
if solution.reached:
    print(write_plan(solution.plan, world))
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from robotouille.planning.beam.assignment import goal_assignments
from robotouille.planning.beam.beam_search import BeamResult, BeamSearch, SearchStyle
from robotouille.planning.beam.goal_ordering import Ordering
from robotouille.planning.beam.relevance import Relevance
from robotouille.planning.beam.remaining_work_heuristic import (
    GoalBinding,
    HeuristicContext,
    RemainingWork,
)
from robotouille.planning.plan import Plan
from robotouille.planning.repair.action_elimination import eliminate_actions
from robotouille.world.world import State, World

__all__ = ["PLANNER", "UNSOLVED_FACTOR", "BeamPlanner", "Solution"]

PLANNER = "beam 1"
"""Its name and version in results."""

EXPANSIONS = 4_000
"""States expanded by default, counting one for each player's choice: about half a second."""

MAX_STEPS = 5_000

UNSOLVED_FACTOR = 4
"""How many times as much is spent as long as no plan has been found."""

WIDTHS = (16, 16, 32, 32, 64, 64, 128, 128, 256, 256, 512, 512, 1024, 1024, 2048, 2048, 4096)
STYLE_WEIGHTS = ((0.0, 0.0), (0.02, 0.5), (0.0, 0.5), (0.02, 0.0), (0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Solution:
    """A plan; if it does not reach the goal, it leads as near as was found.

    `remaining_work` is the heuristic of where it leads, in steps of one player.
    """

    plan: Plan
    reached: bool
    remaining_work: float
    expansions: int


class BeamPlanner:
    """Finds plans in one world; what it learns about the task it keeps for the next."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._context = HeuristicContext(world)
        self._ordering: Ordering | None = None

    def solve(
        self,
        state: State,
        team: Sequence[str] = (),
        *,
        seed: int = 0,
        expansions: int = EXPANSIONS,
        choices: int = 1,
    ) -> Solution:
        """A plan for the players of `team` (all, if empty), the others doing nothing.

        At least one search is made, and more until as many states are expanded as `expansions`.
        `choices` is the number of choices of objects that are tried. The same arguments give the
        same plan.
        """
        if state.goal_reached:
            return Solution(Plan(()), True, 0.0, 0)
        players = tuple(p for p in self._world.players if p in team or not team)
        searches = [s for s in self._searches(state, players, choices) if s is not None]
        best: BeamResult | None = None
        spent = 0
        for style, number in _styles(len(players)):
            reached = best is not None and best.reached
            most = expansions if reached else UNSOLVED_FACTOR * expansions
            if not searches or spent >= most:
                break
            search = searches[number % len(searches)]
            limit = len(best.steps) if best is not None and best.reached else MAX_STEPS
            found = search.run(style, seed + number, limit, most - spent)
            spent += found.expansions + 1
            best = _better(best, found)
        return self._solution(state, best, spent)

    def _solution(self, state: State, best: BeamResult | None, spent: int) -> Solution:
        if best is None:
            return Solution(Plan(()), False, float("inf"), spent)
        if not best.reached:
            return Solution(Plan(best.steps), False, best.remaining_work, spent)
        return Solution(eliminate_actions(Plan(best.steps), state), True, 0.0, spent)

    def _searches(
        self, state: State, players: tuple[str, ...], choices: int
    ) -> Iterator[BeamSearch]:
        self._context.refresh()
        ordering = self.ordering
        for binding in goal_assignments(self._context, state, ordering, choices):
            yield self._search(state, binding, players, ordering)

    def _search(
        self,
        state: State,
        binding: GoalBinding,
        players: tuple[str, ...],
        ordering: Ordering | None,
    ) -> BeamSearch:
        rules = ordering.rules(binding) if ordering is not None else None
        heuristic = RemainingWork(self._context, binding, state.facts, rules)
        relevance = Relevance(self._context, state, heuristic, len(players))
        return BeamSearch(self._world, state, heuristic, relevance, players)

    @property
    def ordering(self) -> Ordering | None:
        """What has to be done before what; None where the goal cannot be met."""
        if self._ordering is None:
            self._context.refresh()
            bindings = goal_assignments(self._context, self._world.initial)
            if bindings:
                self._ordering = Ordering(self._context, bindings[0])
        return self._ordering


def _styles(players: int) -> Iterator[tuple[SearchStyle, int]]:
    """Searches that differ, the narrow ones first."""
    for number, width in enumerate(WIDTHS):
        effort, chain = STYLE_WEIGHTS[number % len(STYLE_WEIGHTS)]
        yield SearchStyle(width, effort, chain if players > 1 else 0.0), number


def _better(best: BeamResult | None, found: BeamResult) -> BeamResult:
    if best is None or (found.reached and not best.reached):
        return found
    if found.reached and len(found.steps) < len(best.steps):
        return found
    if not found.reached and not best.reached and found.remaining_work < best.remaining_work:
        return found
    return best
