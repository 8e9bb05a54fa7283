"""Order of the parts of a goal, found by experiments.

If the top of a sandwich is laid first, it has to come off again. The planner finds such orders
without knowing sandwiches. For two objects of the goal and one player, it brings the first to its
goal. Then it tries to bring the second to its goal without disturbing the first. If this fails,
the second one must come first. Equivalent pairs are tried once.

A slice is brought to its goal together with the stack below it. Alone, the planner could lay it on
the bread in its crate, where it would be in the way of everything else.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from robotouille.domain.schema import GoalTerm
from robotouille.planning.beam.beam_search import BeamSearch, Relevance, SearchStyle
from robotouille.planning.beam.remaining_work_heuristic import (
    GoalBinding,
    HeuristicContext,
    RemainingWork,
)
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.grounding.objects import Atom
from robotouille.world.world import State, World

WIDTH = 8
LAYERS = 40

Id = int | str


class Ordering:
    """For each variable of a goal, the variables to satisfy before it."""

    def __init__(self, context: HeuristicContext, binding: GoalBinding) -> None:
        self._world = context.world
        if len(context.world.players) > 1:
            stop = context.stop
            context = HeuristicContext(World(replace(context.world.task, seats=1)))
            context.stop = stop
            context.refresh()
        self._context = context
        self._goal = context.world.goal
        self._binding = self._on_free_stations(binding)
        self._lasting = _lasting(context)
        self._terms = self._owned()
        rules = context.world.task.domain.layout or ()
        self._resting = {rule.predicate for rule in rules if rule.when == "next_in_stack"}
        self._after: dict[tuple[Id, ...], State | None] = {}
        self._tried: dict[tuple[object, ...], bool] = {}
        self.before: dict[Id, tuple[Id, ...]] = {
            late: tuple(early for early in self._terms if self._must_wait(late, early))
            for late in self._terms
        }

    def rules(self, binding: GoalBinding) -> dict[str, tuple[int, int]]:
        """Return for each waiting object the masks of its own goal and of the earlier goals."""
        table = self._world.table
        masks = {v: table.mask(self._atoms(v, binding)) for v in self._terms}
        rules = {}
        for late, earlier in self.before.items():
            needed = 0
            for early in earlier:
                needed |= masks[early]
            if needed and masks[late]:
                rules[binding[late]] = (masks[late], needed)
        return rules

    def _on_free_stations(self, binding: GoalBinding) -> GoalBinding:
        """Return the same choice with empty stations where possible."""
        analysis = self._context.analysis
        table = self._context.world.table
        facts = self._context.world.initial.facts
        found = dict(binding)
        for variable, chosen in binding.items():
            if chosen not in analysis.stations:
                continue
            taken = set(found.values())
            for name in self._goal.candidates(variable):
                about = bits_of(facts & table.mentions(name))
                free = not any(analysis.movables_in(table.atoms[i]) for i in about)
                if free and name not in taken:
                    found[variable] = name
                    break
        return found

    def _owned(self) -> dict[Id, list[GoalTerm]]:
        """Return for each variable the goal's predicates that belong to it and can be undone."""
        terms: dict[Id, list[GoalTerm]] = {}
        for term in self._goal.terms:
            owner = next((i for i in term.ids if self._is_movable(i)), None)
            if owner is not None and not (len(term.ids) == 1 and term.predicate in self._lasting):
                terms.setdefault(owner, []).append(term)
        return terms

    def _is_movable(self, variable: Id) -> bool:
        analysis = self._context.analysis
        return analysis.is_movable(analysis.type_of(self._binding[variable]))

    def _atoms(self, variable: Id, binding: GoalBinding) -> list[Atom]:
        return [(t.predicate, *(binding[i] for i in t.ids)) for t in self._terms[variable]]

    def _must_wait(self, late: Id, early: Id) -> bool:
        if late == early or not self._related(late, early):
            return False
        key = self._signature(late, early)
        if key not in self._tried:
            self._tried[key] = self._try(late, early)
        return self._tried[key]

    def _related(self, first: Id, second: Id) -> bool:
        mine = {i for term in self._terms[first] for i in term.ids}
        return any(i in mine for term in self._terms[second] for i in term.ids)

    def _signature(self, late: Id, early: Id) -> tuple[object, ...]:
        """Return a key that is equal for pairs that differ only in names and kinds of movables."""
        numbers: dict[Id, int] = {late: 0, early: 1}
        rows: list[object] = []
        for owner in (late, early):
            for term in sorted(self._terms[owner], key=lambda t: t.predicate):
                places = tuple(numbers.setdefault(i, len(numbers)) for i in term.ids)
                rows.append((owner == late, term.predicate, places))
        kinds = tuple(sorted(self._describe(i, number) for i, number in numbers.items()))
        return (tuple(rows), kinds)

    def _describe(self, variable: Id, number: int) -> tuple[int, str]:
        name = self._binding[variable]
        if self._is_movable(variable):
            return number, self._context.analysis.class_of(name)
        return number, self._goal.variables[variable].kind

    def _try(self, first: Id, second: Id) -> bool:
        """Return whether satisfying one variable first makes the other impossible."""
        stack = self._stack(first)
        start = (first,) if second in stack else stack
        if start not in self._after:
            self._after[start] = self._achieve(self._context.world.initial, start, 0)
        state = self._after[start]
        if state is None:
            return False
        kept = self._context.world.table.mask(self._atoms(first, self._binding))
        return self._achieve(state, self._stack(second), kept) is None

    def _stack(self, variable: Id) -> tuple[Id, ...]:
        """Return a variable and those below it in a stack of the goal."""
        found = [variable]
        for each in found:
            below = (t.ids[1] for t in self._terms[each] if t.predicate in self._resting)
            found += [other for other in below if other in self._terms and other not in found]
        return tuple(found)

    def _achieve(self, state: State, variables: tuple[Id, ...], kept: int) -> State | None:
        """Return a state in which the variables' predicates and `kept` are true, or None."""
        atoms = [atom for v in variables for atom in self._atoms(v, self._binding)]
        if self._context.world.table.mask(atoms) & ~state.facts == 0:
            return state
        heuristic = RemainingWork(self._context, self._binding, state.facts, None, atoms, kept)
        team = self._context.world.players
        relevance = Relevance(self._context, state, heuristic, len(team))
        search = BeamSearch(self._context.world, state, heuristic, relevance, team)
        found = search.run(SearchStyle(WIDTH), 0, LAYERS, WIDTH * LAYERS)
        if not found.reached:
            return None
        for joint in found.steps:
            state = state.step(joint).state
        return state


def _lasting(context: HeuristicContext) -> set[str]:
    """Return the predicates that nothing makes false."""
    lasting = set(context.world.table.fluents)
    for schema in context.world.schemas:
        definition = schema.definition
        lasting -= {c.predicate for c in definition.immediate_fx if not c.is_true}
        for effect in definition.sfx:
            lasting -= set(_undone(effect))
    return lasting


def _undone(effect: object) -> Iterator[str]:
    for c in getattr(effect, "fx", ()):
        if not c.is_true or getattr(effect, "reverts", False):
            yield c.predicate
    for nested in getattr(effect, "sfx", ()):
        yield from _undone(nested)
