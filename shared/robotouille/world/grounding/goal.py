"""The goal test: a backtracking search for objects that make all goal predicates true.

A goal is never expanded into all combinations of objects; see docs/episodes.md, "Goals".
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

from robotouille.domain.schema import GoalTerm
from robotouille.domain.task import Task
from robotouille.errors import GoalTooHardError
from robotouille.world.grounding.atoms import EXISTS, AtomTable, bits_of
from robotouille.world.grounding.objects import Atom, Object

Binding = dict[int | str, str]
Domains = dict[int | str, frozenset[str]]
Order = tuple[tuple[int, tuple[int, ...]], ...]
Rows = list[tuple[GoalTerm, list[tuple[str, ...]]]]
"""Predicates of a goal with the arguments for which each of them is true."""

MAX_KEPT = 20_000
"""Largest number of cached results. A full cache is cleared."""


MAX_WORK = 60_000
"""Rows of `Rows` that a search looks at before its next answer: about 0.1 s, because servers check
the goal in every step. Shipped tasks need 3,000 at most."""
MAX_FIT_WORK = 3 * MAX_WORK
"""Rows at which `Goal.fit` looks in all its searches together."""


class _Work:
    """Rows at which searches have looked, up to a limit.

    With `each`, the count begins again after every answer.
    """

    def __init__(self, limit: int = MAX_WORK, *, each: bool = True) -> None:
        self._limit = limit
        self._each = each
        self._rows = 0

    def add(self, rows: int) -> None:
        """Count rows.

        Raises:
            GoalTooHardError: There are more than the limit.
        """
        self._rows += rows
        if self._rows > self._limit:
            raise GoalTooHardError(
                "the goal is too hard to check: it has too many choices of objects that meet some "
                "of its predicates"
            )

    def answered(self) -> None:
        """Note that a search has an answer."""
        self._rows = 0 if self._each else self._rows


@dataclass(frozen=True, slots=True)
class Variable:
    """Variable of a goal: any object of a kind or type, or one particular object (`fixed`)."""

    id: int | str
    kind: str
    is_type: bool
    fixed: str | None = None


class Fit(NamedTuple):
    """Predicates of a goal that hold at the same time, and the objects for which they hold."""

    holding: tuple[bool, ...]
    chosen: Binding


class Goal:
    """Goal of a task over the atoms of its world.

    Args:
        task: The task. If it has a shift, its own goal is never reached.
        table: The atoms of its world.
        objects: Returns the objects of its world.
        terms: Other predicates instead of the goal, such as those of a dish.
    """

    def __init__(
        self,
        task: Task,
        table: AtomTable,
        objects: Callable[[], tuple[Object, ...]],
        terms: tuple[GoalTerm, ...] | None = None,
    ) -> None:
        self._table = table
        self._objects = objects
        self.terms = task.problem.goal if terms is None else terms
        self._never = terms is None and task.problem.shift is not None
        types = set(task.domain.object_types)
        labels = {o.label: o.name for o in objects() if o.label is not None}
        self.variables: dict[int | str, Variable] = {}
        for term in self.terms:
            for identifier, kind in zip(term.ids, term.args, strict=True):
                if identifier not in self.variables:
                    fixed = labels.get(identifier) if isinstance(identifier, str) else None
                    variable = Variable(identifier, kind, kind in types, fixed)
                    self.variables[identifier] = variable
        kinds = Counter(v.kind for v in self.variables.values())
        self._groups = [
            [v.id for v in self.variables.values() if v.kind == kind]
            for kind, count in kinds.items()
            if count > 1
        ]
        self.refresh()

    def refresh(self) -> None:
        """Include objects that have been added to the world."""
        self._candidates = {v.id: self._candidates_of(v) for v in self.variables.values()}
        self._mask = {term: self._possible(term) for term in self.terms}
        named = {term.predicate for term in self.terms}
        # By predicate, because a goal may have a thousand terms of one.
        self._static: dict[str, list[Atom]] = {predicate: [] for predicate in named}
        for atom in sorted(atom for atom in self._table.static if atom[0] in named):
            self._static[atom[0]].append(atom)
        self.relevant = 0
        # No facts have a bit under the mask 0.
        self._necessary: list[int] = [0] if self._never else []
        self._known: dict[int, bool] = {}
        self._fits: dict[tuple[int, Order], Fit] = {}
        self._in_order: Order = tuple((n, ()) for n in range(len(self.terms)))
        for term, mask in self._mask.items():
            if term.predicate not in self._table.static_predicates:
                self.relevant |= mask
                self._necessary.append(mask)
            else:
                names = {name for i in term.ids for name in self._candidates[i]}
                self.relevant |= self._table.mask((EXISTS, name) for name in names)

    def reached(self, facts: int) -> bool:
        """Return whether the goal holds."""
        # In most states, some predicate of the goal is true of no objects at all.
        for mask in self._necessary:
            if not facts & mask:
                return False
        # Other facts cannot matter, so states that differ only in them share a result.
        relevant = facts & self.relevant
        known = self._known.get(relevant)
        if known is None:
            if len(self._known) >= MAX_KEPT:
                self.forget()
            known = self._known[relevant] = next(self.assignments(facts), None) is not None
        return known

    def forget(self) -> None:
        """Clear the cache of `reached`."""
        self._known.clear()

    def holding(self, facts: int) -> tuple[bool, ...]:
        """Return for each predicate of the goal whether it holds, in the problem's order.

        A predicate holds if some choice of objects makes it true together with all earlier
        predicates that hold. All predicates hold exactly if the goal does, unless the search for
        choices takes too long: predicates that cannot be decided in time count as not true.
        """
        return self.fit(facts).holding

    def fit(self, facts: int, order: Order | None = None) -> Fit:
        """Return which predicates hold, and for which objects.

        Args:
            facts: The state's facts.
            order: The predicates' numbers in the order in which they are tried. Each has the
                numbers of predicates that must hold for it to count. By default, it is the
                problem's order.
        """
        key = facts & self.relevant, order or self._in_order
        known = self._fits.get(key)
        if known is None:
            if len(self._fits) >= MAX_KEPT:
                self._fits.clear()
            known = self._fits[key] = self._find_fit(facts, key[1])
        return known

    def _find_fit(self, facts: int, order: Order) -> Fit:
        held: Rows = []
        chosen: Binding = {}
        work = _Work(MAX_FIT_WORK, each=False)
        holding = [False] * len(self.terms)
        for number, needs in order:
            if not all(holding[each] for each in needs):
                continue
            term = self.terms[number]
            try:
                rows = [*held, (term, self._rows(term, facts, work))]
                # Usually the earlier choices can stay; otherwise all of them are reconsidered.
                found = self._extended(chosen, *rows[-1]) or self._choice(rows, work)
            except GoalTooHardError:
                # A condition that takes too long to decide counts as not true.
                continue
            if found is not None:
                held, chosen = rows, found
                holding[number] = True
        return Fit(tuple(holding), chosen)

    def _extended(
        self, chosen: Binding, term: GoalTerm, choices: list[tuple[str, ...]]
    ) -> Binding | None:
        """Extend a choice so that it makes one more predicate true; None if that is impossible."""
        for names in choices:
            more = {i: name for i, name in zip(term.ids, names, strict=True) if i not in chosen}
            both = {**chosen, **more}
            fits = all(both[i] == name for i, name in zip(term.ids, names, strict=True))
            if fits and all(self._is_free(chosen, i, name) for i, name in more.items()):
                return both
        return None

    def _is_free(self, chosen: Binding, identifier: int | str, name: str) -> bool:
        """Return whether no variable of the same kind is bound to an object."""
        kind = self.variables[identifier].kind
        return all(name != taken or self.variables[i].kind != kind for i, taken in chosen.items())

    def _choice(self, rows: Rows, work: _Work) -> Binding | None:
        """Return a choice of objects that makes these predicates true, or None."""
        names = dict.fromkeys(identifier for term, _ in rows for identifier in term.ids)
        domains: Domains = {name: frozenset(self._candidates[name]) for name in names}
        return next(self._search(domains, rows, work), None)

    def assignments(self, facts: int) -> Iterator[Binding]:
        """Yield every choice of objects that makes the goal true."""
        work = _Work()
        rows = [(term, self._rows(term, facts, work)) for term in self.terms]
        work.answered()
        yield from self._search({i: frozenset(c) for i, c in self._candidates.items()}, rows, work)

    def candidates(self, identifier: int | str) -> tuple[str, ...]:
        """Return the objects to which a variable can be bound."""
        return self._candidates[identifier]

    def atoms(self, binding: Binding) -> list[Atom]:
        """Return the goal's atoms for a choice of objects."""
        return [(t.predicate, *(binding[i] for i in t.ids)) for t in self.terms]

    def possible_mask(self, term: GoalTerm) -> int:
        """Return the mask of the atoms that can satisfy one predicate of the goal."""
        return self._mask[term]

    def _possible(self, term: GoalTerm) -> int:
        if term.predicate in self._table.static_predicates:
            return 0
        free = (None,) * len(term.ids)
        mask = self._table.matching((term.predicate, *free))
        for argument, identifier in enumerate(term.ids):
            allowed = 0
            for name in self._candidates[identifier]:
                pattern = (*free[:argument], name, *free[argument + 1 :])
                allowed |= self._table.matching((term.predicate, *pattern))
            mask &= allowed
        return mask

    def _candidates_of(self, variable: Variable) -> tuple[str, ...]:
        if variable.fixed is not None:
            return (variable.fixed,)
        return tuple(
            o.name
            for o in self._objects()
            if (o.type if variable.is_type else o.kind) == variable.kind
        )

    def _rows(self, term: GoalTerm, facts: int, work: _Work) -> list[tuple[str, ...]]:
        """Return the arguments for which a predicate of the goal is true.

        Raises:
            GoalTooHardError: There are more of them than `work` has left.
        """
        if term.predicate in self._table.static_predicates:
            static = self._static[term.predicate]
            work.add(len(static))
            atoms = [
                atom
                for atom in static
                if self._table.holds(atom, facts) and self._are_candidates(term, atom[1:])
            ]
        else:
            true = facts & self._mask[term]
            work.add(true.bit_count())
            atoms = [self._table.atoms[i] for i in bits_of(true)]
        return [atom[1:] for atom in atoms if self._suits(term, atom[1:])]

    def _are_candidates(self, term: GoalTerm, names: tuple[str, ...]) -> bool:
        return all(name in self._candidates[i] for i, name in zip(term.ids, names, strict=True))

    def _suits(self, term: GoalTerm, names: tuple[str, ...]) -> bool:
        """Return whether equal ids get one object and different ids of a kind different objects."""
        for (one, name), (other, taken) in combinations(zip(term.ids, names, strict=True), 2):
            alike = self.variables[one].kind == self.variables[other].kind
            if name != taken if one == other else name == taken and alike:
                return False
        return True

    def _search(self, domains: Domains, rows: Rows, work: _Work) -> Iterator[Binding]:
        """Narrow the choices, then branch on the variable with the fewest choices left.

        Raises:
            GoalTooHardError: The search takes more than MAX_WORK.
        """
        narrowed = self._narrow(domains, rows, work)
        if narrowed is None:
            return
        domains, rows = narrowed
        undecided = [identifier for identifier, names in domains.items() if len(names) > 1]
        if not undecided:
            work.answered()
            yield {identifier: name for identifier, (name,) in domains.items()}
            return
        chosen = min(undecided, key=lambda identifier: len(domains[identifier]))
        for name in self._candidates[chosen]:
            if name in domains[chosen]:
                yield from self._search({**domains, chosen: frozenset((name,))}, rows, work)

    def _narrow(self, domains: Domains, rows: Rows, work: _Work) -> tuple[Domains, Rows] | None:
        """Remove choices that contradict another predicate; return None if none is left.

        Together with the test that there are enough objects of each kind, this keeps the search
        from trying all permutations of interchangeable objects.
        """
        domains, rows = dict(domains), list(rows)
        before = None
        while before != domains:
            before = dict(domains)
            for position, (term, choices) in enumerate(rows):
                work.add(len(choices))
                pools = [domains[identifier] for identifier in term.ids]
                kept = [
                    names
                    for names in choices
                    if all(name in pool for name, pool in zip(names, pools, strict=True))
                ]
                if not kept:
                    return None
                rows[position] = (term, kept)
                for identifier, column in zip(term.ids, zip(*kept, strict=True), strict=True):
                    domains[identifier] = domains[identifier].intersection(column)
            for group in self._groups:
                chosen = [identifier for identifier in group if identifier in domains]
                if not _make_different(domains, chosen):
                    return None
        return domains, rows


def _make_different(domains: Domains, group: list[int | str]) -> bool:
    """Remove decided objects from the other variables; return whether enough objects are left.

    The test is a bipartite matching of variables and objects by augmenting paths.
    """
    for identifier in group:
        if len(domains[identifier]) == 1:
            for other in group:
                if other != identifier:
                    domains[other] -= domains[identifier]
    owners: dict[str, int | str] = {}

    def find(identifier: int | str, tried: set[str]) -> bool:
        for name in domains[identifier] - tried:
            tried.add(name)
            if name not in owners or find(owners[name], tried):
                owners[name] = identifier
                return True
        return False

    return all(find(identifier, set()) for identifier in group)
