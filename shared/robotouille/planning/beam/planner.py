"""Beam planner for one player or a team, from any state.

planner = BeamPlanner(world)
solution = planner.solve(world.initial)
if solution.reached:
    print(write_plan(solution.plan, world))
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

from robotouille.planning.beam.beam_search import BeamResult, BeamSearch, Relevance, SearchStyle
from robotouille.planning.beam.goal_ordering import Ordering
from robotouille.planning.beam.remaining_work_heuristic import (
    REDOING,
    GoalBinding,
    HeuristicContext,
    RemainingWork,
    StoppedError,
)
from robotouille.planning.plan import Plan, eliminate_actions
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.grounding.objects import Atom
from robotouille.world.world import State, World

MAX_STATIONS = 4
"""Maximum number of alternative stations for a variable."""
MAX_WORK = 500_000
"""Limit of a search for a choice of objects: comparisons, times variables, times objects. Shipped
tasks need up to 240,000."""


def goal_assignments(
    context: HeuristicContext, state: State, ordering: Ordering | None = None, limit: int = 1
) -> list[GoalBinding]:
    """Return at most `limit` choices of objects with little work, the best first."""
    chooser = _Chooser(context, state, ordering)
    # The first choice is a local optimum: no change of one variable and no exchange of two improves
    # it.
    start = chooser.greedy()
    if start is None:
        return []
    best = chooser.improve(start)
    if limit == 1:
        return [best]
    others = [chooser.improve(b) for b in [*chooser.neighbours(best, wide=True)][: 3 * limit]]
    near = sorted(enumerate(others), key=lambda pair: (chooser.cost(pair[1]), pair[0]))
    found = [best]
    for _, binding in near:
        if binding not in found:
            found.append(binding)
    return found[:limit]


class _Chooser:
    def __init__(self, context: HeuristicContext, state: State, ordering: Ordering | None) -> None:
        self._ordering = ordering
        forecast = context.forecast(state.facts, state.timers)
        self._context = context
        self._goal = state.world.goal
        self._table = state.world.table
        self._facts = (state.facts | forecast.touched) ^ forecast.removed
        self._variables = dict(self._goal.variables)
        self._candidates = {v: self._available(v) for v in self._variables}
        self._above = context.analysis.above(self._facts)
        self._choices_left = MAX_WORK // max(1, len(self._variables) * len(state.world.thing_names))

    def _available(self, variable: int | str) -> list[str]:
        """Return the existing candidates, then as many future ones as the goal could need."""
        analysis = self._context.analysis
        names = self._goal.candidates(variable)
        unborn = [n for n in names if not analysis.was_used(n, self._facts)]
        kind = self._variables[variable].kind
        wanted = sum(v.kind == kind for v in self._variables.values())
        return [n for n in names if analysis.exists(n, self._facts)] + unborn[:wanted]

    def greedy(self) -> GoalBinding | None:
        """Return for each variable the candidate that meets most of the goal already."""
        binding: GoalBinding = {}
        for variable in self._variables:
            free = [c for c in self._candidates[variable] if self._is_free(c, variable, binding)]
            if not free:
                return None
            scores = [-self._met({**binding, variable: c}, variable) for c in free]
            binding[variable] = free[scores.index(min(scores))]
        return binding

    def _is_free(self, name: str, variable: int | str, binding: GoalBinding) -> bool:
        kind = self._variables[variable].kind
        return all(
            taken != name or self._variables[other].kind != kind for other, taken in binding.items()
        )

    def _met(self, binding: GoalBinding, variable: int | str) -> float:
        """Return how many predicates about a variable are true, or could be by other choices."""
        met = 0.0
        for term in self._goal.terms:
            if variable in term.ids:
                pattern = tuple(binding.get(i) for i in term.ids)
                atom = (term.predicate, *pattern)
                if None not in pattern:
                    met += self._table.holds(atom, self._facts)  # type: ignore[arg-type]
                elif term.predicate not in self._table.static_predicates:
                    allowed = self._goal.possible_mask(term)
                    met += 0.5 * bool(self._facts & allowed & self._table.matching(atom))
        return met

    def cost(self, binding: GoalBinding) -> float:
        """Return the expected work of a choice."""
        atoms: list[Atom] = self._goal.atoms(binding)
        total = 0.0
        self._context.check_stop()
        for atom in atoms:
            if not self._table.holds(atom, self._facts):
                total += 0.01
        for part in self._context.parts(atoms, self._facts):
            total += part.distance(self._facts)
        total += 0.01 * sum(self._burden(name, binding) for name in binding.values())
        if self._ordering is not None:
            for late, early in self._ordering.rules(binding).values():
                if self._facts & late == late and self._facts & early != early:
                    total += REDOING * self._context.analysis.errand
        return total

    def _burden(self, name: str, binding: GoalBinding) -> int:
        """Return the number of objects on another one that the goal does not need."""
        needed, above, count = set(binding.values()), self._above, 0
        while (name := above.get(name, "")) and count < len(above):
            count += name not in needed
        return count

    def improve(self, binding: GoalBinding) -> GoalBinding:
        """Return the local optimum near a choice, or the best choice found within the limit."""
        cost = self.cost(binding)
        improved = True
        while improved:
            improved = False
            for other in self.neighbours(binding):
                self._choices_left -= 1
                if self._choices_left < 0:
                    return binding
                other_cost = self.cost(other)
                if other_cost < cost - 1e-6:
                    binding, cost, improved = other, other_cost, True
                    break
        return binding

    def neighbours(self, binding: GoalBinding, wide: bool = False) -> Iterator[GoalBinding]:
        """Yield the choices that differ in one variable, or by an exchange of two of one kind."""
        for variable, chosen in binding.items():
            for candidate in self._alternatives(variable, binding, wide):
                if candidate == chosen:
                    continue
                changed = {**binding, variable: candidate}
                kind = self._variables[variable].kind
                for other, taken in binding.items():
                    if taken == candidate and self._variables[other].kind == kind:
                        changed[other] = chosen
                if all(c in self._candidates[v] for v, c in changed.items()):
                    yield changed

    def _alternatives(self, variable: int | str, binding: GoalBinding, wide: bool) -> list[str]:
        """Return all candidates; of stations, only those that meet as much of the goal."""
        names = self._candidates[variable]
        analysis = self._context.analysis
        if not names or analysis.type_of(names[0]) not in analysis.station_types:
            return names
        met = {n: self._met({**binding, variable: n}, variable) for n in names}
        others = sorted((n for n in names), key=lambda n: -met[n])
        empty = [n for n in others if self._is_empty(n)]
        if wide:
            return others
        least = met[binding[variable]] - 1.0
        return [n for n in others if met[n] >= least][:MAX_STATIONS] + empty[:1]

    def _is_empty(self, station: str) -> bool:
        analysis = self._context.analysis
        atoms = self._table.atoms
        about = self._facts & self._table.mentions(station)
        return not any(analysis.movables_in(atoms[i]) for i in bits_of(about))


PLANNER = "beam 1"
"""Name and version in results."""

EXPANSIONS = 4_000
"""Default number of expansions, one for each player's choice: about half a second."""

MAX_STEPS = 5_000

MAX_KEPT = 64
"""Maximum number of states whose choices of objects are cached."""

UNSOLVED_FACTOR = 4
"""Factor of the expansions while no plan has been found."""

WIDTHS = (16, 16, 32, 32, 64, 64, 128, 128, 256, 256, 512, 512, 1024, 1024, 2048, 2048, 4096)
STYLE_WEIGHTS = ((0.0, 0.0), (0.02, 0.5), (0.0, 0.5), (0.02, 0.0), (0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Solution:
    """A plan that reaches the goal or leads as near to it as possible.

    `remaining_work` is the heuristic of the last state, in steps of one player.
    """

    plan: Plan
    reached: bool
    remaining_work: float
    expansions: int


class BeamPlanner:
    """Planner for one world, which caches its analysis of the task."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._context = HeuristicContext(world)
        self._ordering: Ordering | None = None
        self._assigned: dict[tuple[State, int, int], list[GoalBinding]] = {}

    def analyse(self, state: State, choices: int, parts: int) -> int:
        """Analyse what all searches from a state need, and return the number of new parts.

        The analysis of a new task takes a second or more. If the number is `parts`, the maximum,
        another call continues.
        """
        context = self._context
        before, ordering = context.analysed, self._ordering
        context.stop = lambda: context.analysed - before >= parts
        with suppress(StoppedError):
            if self.ordering is not ordering:
                return parts  # This takes as long as the analysis of some parts.
            self._assignments(state, choices)
        return context.analysed - before

    def solve(
        self,
        state: State,
        team: Sequence[str] = (),
        *,
        seed: int = 0,
        expansions: int = EXPANSIONS,
        choices: int = 1,
        stop: Callable[[], bool] | None = None,
    ) -> Solution:
        """Return a plan for the players of `team` (by default all), while the others do nothing.

        At least one search runs, and more until `expansions` are used. `choices` is the number of
        choices of objects to try. `stop` returns whether to stop at once. Equal arguments give
        equal plans, unless `stop` ends the search.
        """
        if state.goal_reached:
            return Solution(Plan(()), True, 0.0, 0)
        players = tuple(p for p in self._world.players if p in team or not team)
        found: tuple[BeamResult | None, int] = (None, 0)
        self._context.stop = stop
        with suppress(StoppedError):
            for better in self._bests(state, players, (seed, expansions, choices)):
                found = better
        return self._solution(state, *found)

    def _bests(
        self, state: State, players: tuple[str, ...], effort: tuple[int, int, int]
    ) -> Iterator[tuple[BeamResult, int]]:
        """Yield the best result so far and the expansions spent, after each search."""
        seed, expansions, choices = effort
        searches = list(self._searches(state, players, choices))
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
            yield best, spent

    def _solution(self, state: State, best: BeamResult | None, spent: int) -> Solution:
        if best is None:
            return Solution(Plan(()), False, float("inf"), spent)
        if not best.reached:
            return Solution(Plan(best.steps), False, best.remaining_work, spent)
        return Solution(eliminate_actions(Plan(best.steps), state), True, 0.0, spent)

    def _searches(
        self, state: State, players: tuple[str, ...], choices: int
    ) -> Iterator[BeamSearch]:
        for binding in self._assignments(state, choices):
            yield self._search(state, binding, players, self.ordering)

    def _assignments(self, state: State, choices: int) -> list[GoalBinding]:
        """Return choices of objects, which all searches from a state share."""
        self._context.refresh()
        key = state, choices, len(self._world.table.atoms)
        if key not in self._assigned:
            found = goal_assignments(self._context, state, self.ordering, choices)
            if len(self._assigned) >= MAX_KEPT:
                self._assigned.clear()
            self._assigned[key] = found
        return self._assigned[key]

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
        """Order of the goal's parts, or None if the goal cannot be met."""
        if self._ordering is None:
            self._context.refresh()
            bindings = goal_assignments(self._context, self._world.initial)
            if bindings:
                self._ordering = Ordering(self._context, bindings[0])
        return self._ordering


def _styles(players: int) -> Iterator[tuple[SearchStyle, int]]:
    """Yield different searches, the narrow ones first."""
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
