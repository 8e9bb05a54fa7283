"""Which objects are to meet the goal: a choice for each of its variables."""

from __future__ import annotations

from collections.abc import Iterator

from robotouille.planning.beam.goal_ordering import Ordering
from robotouille.planning.beam.remaining_work_heuristic import (
    REDOING,
    GoalBinding,
    HeuristicContext,
)
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.grounding.objects import Atom
from robotouille.world.world import State

__all__ = ["goal_assignments"]

MAX_STATIONS = 4
"""How many stations are considered for a variable besides the one it stands for."""


def goal_assignments(
    context: HeuristicContext, state: State, ordering: Ordering | None = None, limit: int = 1
) -> list[GoalBinding]:
    """Choices of objects that promise little work, the best first, at most `limit`.

    The first is a local optimum: no change of one variable and no exchange of two improves it.
    """
    chooser = _Chooser(context, state, ordering)
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

    def _available(self, variable: int | str) -> list[str]:
        """The candidates that exist, then as many that are yet to be made as could be wanted."""
        analysis = self._context.analysis
        names = self._goal.candidates(variable)
        unborn = [n for n in names if not analysis.was_used(n, self._facts)]
        kind = self._variables[variable].kind
        wanted = sum(v.kind == kind for v in self._variables.values())
        return [n for n in names if analysis.exists(n, self._facts)] + unborn[:wanted]

    def greedy(self) -> GoalBinding | None:
        """Variable by variable, the candidate that meets most of the goal as it is."""
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
        """How many predicates about a variable are true of it, or could be by other choices."""
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
        """The work that a choice promises."""
        atoms: list[Atom] = self._goal.atoms(binding)
        total = 0.0
        for atom in atoms:
            if not self._table.holds(atom, self._facts):
                total += 0.01
        for part in self._context.parts(atoms, self._facts):
            total += part.distance(self._facts)
        if self._ordering is not None:
            for late, early in self._ordering.rules(binding).values():
                if self._facts & late == late and self._facts & early != early:
                    total += REDOING * self._context.analysis.errand
        return total

    def improve(self, binding: GoalBinding) -> GoalBinding:
        """The local optimum that a choice leads to."""
        cost = self.cost(binding)
        improved = True
        while improved:
            improved = False
            for other in self.neighbours(binding):
                other_cost = self.cost(other)
                if other_cost < cost - 1e-6:
                    binding, cost, improved = other, other_cost, True
                    break
        return binding

    def neighbours(self, binding: GoalBinding, wide: bool = False) -> Iterator[GoalBinding]:
        """The choices that differ in one variable, or by an exchange of two of a kind."""
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
        """All candidates; of stations, only those where as much of the goal is met already."""
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
