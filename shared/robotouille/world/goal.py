"""Goal test: find objects that make every predicate of the goal true, by backtracking.

A goal is never expanded into all its combinations (world.md, "Goals").
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from robotouille.domain.schema import GoalTerm
from robotouille.domain.task import Task
from robotouille.world.atoms import EXISTS, AtomTable
from robotouille.world.objects import Atom, Object

__all__ = ["Goal", "Variable"]

Binding = dict[int | str, str]

MAX_KEPT = 100_000


@dataclass(frozen=True, slots=True)
class Variable:
    """An unknown of the goal: any object of a kind (or type), or one particular object."""

    id: int | str
    kind: str
    is_type: bool
    fixed: str | None = None


class Goal:
    """The goal of a task over the atoms of its world."""

    def __init__(
        self, task: Task, table: AtomTable, objects: Callable[[], tuple[Object, ...]]
    ) -> None:
        self._table = table
        self._objects = objects
        self.terms = task.problem.goal
        types = set(task.domain.object_types)
        labels = {o.label: o.name for o in objects() if o.label is not None}
        self.variables: dict[int | str, Variable] = {}
        for term in self.terms:
            for identifier, kind in zip(term.ids, term.args, strict=True):
                if identifier not in self.variables:
                    fixed = labels.get(identifier) if isinstance(identifier, str) else None
                    variable = Variable(identifier, kind, kind in types, fixed)
                    self.variables[identifier] = variable
        self.refresh()

    def refresh(self) -> None:
        """Take account of objects that have been added to the world."""
        self._candidates = {v.id: self._candidates_of(v) for v in self.variables.values()}
        self._masks: dict[tuple[int, tuple[str | None, ...]], int] = {}
        self._order = self._ordered()
        self.relevant = 0
        self._necessary: list[int] = []
        self._known: dict[int, bool] = {}
        for position, term in enumerate(self._order):
            if term.predicate not in self._table.static_predicates:
                mask = self._mask(position, {})
                self.relevant |= mask
                self._necessary.append(mask)
            else:
                names = {name for i in term.ids for name in self._candidates[i]}
                self.relevant |= self._table.mask((EXISTS, name) for name in names)

    def reached(self, facts: int) -> bool:
        """Whether the goal holds. Most states fail here, one of its predicates being nowhere."""
        for mask in self._necessary:
            if not facts & mask:
                return False
        relevant = facts & self.relevant
        known = self._known.get(relevant)
        if known is None:
            if len(self._known) > MAX_KEPT:
                self._known.clear()
            known = self._known[relevant] = next(self.assignments(facts), None) is not None
        return known

    def assignments(self, facts: int) -> Iterator[Binding]:
        """Every choice of objects that makes the goal true in `facts`."""
        yield from self._match(0, {}, facts)

    def candidates(self, identifier: int | str) -> tuple[str, ...]:
        """The objects that a variable can stand for."""
        return self._candidates[identifier]

    def atoms(self, binding: Binding) -> list[Atom]:
        """The goal's predicates under a choice of objects."""
        return [(t.predicate, *(binding[i] for i in t.ids)) for t in self.terms]

    def possible_mask(self, term: GoalTerm) -> int:
        """The atoms that one predicate of the goal could be met by."""
        return self._mask(self._order.index(term), {})

    def _candidates_of(self, variable: Variable) -> tuple[str, ...]:
        if variable.fixed is not None:
            return (variable.fixed,)
        return tuple(
            o.name
            for o in self._objects()
            if (o.type if variable.is_type else o.kind) == variable.kind
        )

    def _ordered(self) -> list[GoalTerm]:
        """Predicates with few possibilities first, then those that share objects with them."""
        rest = list(self.terms)
        order: list[GoalTerm] = []
        known: set[int | str] = set()

        def cost(term: GoalTerm) -> tuple[int, int]:
            size = 1
            for identifier in term.ids:
                if identifier not in known:
                    size *= len(self._candidates[identifier]) or 1
            static = term.predicate in self._table.static_predicates
            return (size, 0 if static else 1)

        while rest:
            best = min(rest, key=cost)
            rest.remove(best)
            order.append(best)
            known.update(best.ids)
        return order

    def _match(self, position: int, binding: Binding, facts: int) -> Iterator[Binding]:
        if position == len(self._order):
            yield dict(binding)
            return
        term = self._order[position]
        if term.predicate in self._table.static_predicates:
            choices = list(self._static_choices(term, facts))
        else:
            found = facts & self._mask(position, binding)
            choices = []
            while found:
                low = found & -found
                choices.append(self._table.atoms[low.bit_length() - 1])
                found ^= low
        for atom in choices:
            extended = self._extend(term, atom, binding)
            if extended is not None:
                yield from self._match(position + 1, extended, facts)

    def _static_choices(self, term: GoalTerm, facts: int) -> Iterator[Atom]:
        for atom in sorted(self._table.static):
            if atom[0] == term.predicate and self._table.holds(atom, facts):
                yield atom

    def _extend(self, term: GoalTerm, atom: Atom, binding: Binding) -> Binding | None:
        extended = binding
        for identifier, name in zip(term.ids, atom[1:], strict=True):
            if identifier in extended:
                if extended[identifier] != name:
                    return None
                continue
            if name not in self._candidates[identifier]:
                return None
            kind = self.variables[identifier].kind
            for other, taken in extended.items():
                if taken == name and self.variables[other].kind == kind:
                    return None
            extended = {**extended, identifier: name}
        return extended

    def _mask(self, position: int, binding: Binding) -> int:
        term = self._order[position]
        pattern = tuple(binding.get(identifier) for identifier in term.ids)
        mask = self._masks.get((position, pattern))
        if mask is None:
            mask = self._table.matching((term.predicate, *pattern))
            for argument, identifier in enumerate(term.ids):
                if pattern[argument] is None:
                    allowed = 0
                    for name in self._candidates[identifier]:
                        single = [None] * len(pattern)
                        allowed |= self._table.matching(
                            (term.predicate, *single[:argument], name, *single[argument + 1 :])
                        )
                    mask &= allowed
            self._masks[(position, pattern)] = mask
        return mask
