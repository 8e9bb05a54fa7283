"""The goal of a relaxation: which choices of objects its variables stand for.

A goal holds for *some* choice of objects. The variables that connect most predicates are given
objects one choice at a time; what is left of a predicate may be met by any fact that matches.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import combinations, product
from math import prod

from robotouille.domain.schema import GoalTerm
from robotouille.planning.search.relaxation.abstract_objects import AbstractObjects
from robotouille.planning.search.relaxation.relaxed_operators import Prop, RelaxedOperator
from robotouille.planning.search.relaxation.schema_grounding import MAX_CHOICES, TooLargeError
from robotouille.world.grounding.goal import Goal, Variable
from robotouille.world.grounding.objects import Atom
from robotouille.world.world import World

__all__ = ["GOAL", "RelaxedGoal"]

GOAL: Prop = ("goal",)

MAX_BINDINGS = 64
"""How many choices of objects are told apart."""

Names = tuple[str | None, ...]


class RelaxedGoal:
    """Operators that add `GOAL`, one for each choice, and what stands for parts of the goal."""

    def __init__(self, world: World, objects: AbstractObjects) -> None:
        self._table = world.table
        self._objects = objects
        self._goal: Goal = world.goal
        self._pools = {v.id: self._pool(v) for v in world.goal.variables.values()}
        self._parts: dict[tuple[object, ...], Prop] = {}
        self.operators: list[RelaxedOperator] = []
        chosen = self._connecting()
        wanted = dict.fromkeys(tuple(sorted(set(p), key=repr)) for p in self._choices(chosen))
        self.operators += [RelaxedOperator(list(props), [GOAL]) for props in wanted]

    def part(self, term: GoalTerm, names: Names | None = None) -> Prop:
        """The proposition that some fact meets a predicate; `names` has the arguments chosen."""
        names = names or (None,) * len(term.ids)
        variables = [self._goal.variables[i] for i in term.ids]
        pattern = (
            term.predicate,
            names,
            tuple((v.fixed, v.kind, term.ids.index(v.id)) for v in variables),
        )
        prop = self._parts.get(pattern)
        if prop is None:
            prop = self._parts[pattern] = self._new_part(term, names)
        return prop

    def _new_part(self, term: GoalTerm, names: Names) -> Prop:
        matching = list(self._matching(term, names))
        if term.predicate in self._table.static_predicates:
            prop: Prop = ("part", len(self._parts))
            if any(atom in self._table.static for atom in matching):
                self.operators.append(RelaxedOperator([], [prop]))
        elif len(matching) == 1:
            prop = ("+", matching[0])
        else:
            prop = ("part", len(self._parts))
            self.operators += [RelaxedOperator([("+", atom)], [prop]) for atom in matching]
        return prop

    def _pool(self, variable: Variable) -> list[str]:
        if variable.fixed is not None:
            return [variable.fixed] if variable.fixed in self._objects.by_name else []
        members = self._objects.members
        return [
            m.name for m in members if (m.type if variable.is_type else m.kind) == variable.kind
        ]

    def _connecting(self) -> list[int | str]:
        """The variables to be told apart, those in most predicates first."""
        uses = Counter(i for term in self._goal.terms for i in term.ids)
        chosen: list[int | str] = []
        size = 1
        for identifier, _ in uses.most_common():
            if size * len(self._pools[identifier]) <= MAX_BINDINGS:
                size *= len(self._pools[identifier])
                chosen.append(identifier)
        return chosen

    def _choices(self, chosen: list[int | str]) -> Iterator[list[Prop]]:
        for names in product(*(self._pools[i] for i in chosen)):
            choice = dict(zip(chosen, names, strict=True))
            if all(self._differ(*pair) for pair in combinations(choice.items(), 2)):
                yield [
                    self.part(term, tuple(choice.get(i) for i in term.ids))
                    for term in self._goal.terms
                ]

    def _matching(self, term: GoalTerm, names: Names) -> Iterator[Atom]:
        pools = [
            self._pools[i] if name is None else [name]
            for i, name in zip(term.ids, names, strict=True)
        ]
        if prod(map(len, pools)) > MAX_CHOICES:
            raise TooLargeError(f"more than {MAX_CHOICES} ways to meet {term.predicate}")
        for arguments in product(*pools):
            pairs = combinations(zip(term.ids, arguments, strict=True), 2)
            if all(self._differ(*pair) for pair in pairs):
                yield (term.predicate, *arguments)

    def _differ(self, one: tuple[int | str, str], other: tuple[int | str, str]) -> bool:
        """Equal ids are equal objects, different ids of a kind different ones.

        An object that stands for many may stand for two.
        """
        if one[0] == other[0]:
            return one[1] == other[1]
        variables = self._goal.variables
        alike = variables[one[0]].kind == variables[other[0]].kind
        return not alike or one[1] != other[1] or one[1] in self._objects.future
