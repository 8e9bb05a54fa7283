"""Requirements of a goal that joined things can contradict."""

from __future__ import annotations

from robotouille.world.grounding.objects import Atom
from robotouille.world.world import State, World
from robotouille_evaluation.metrics.failure_kinds import Subcategory


class GoalRequirements:
    """Requirements of a goal, by kinds of things."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._kinds = ingredients(world)
        prepared = prepared_predicates(world)
        kind_of = {identifier: v.kind for identifier, v in world.goal.variables.items()}
        self._pairs: dict[str, set[tuple[str, ...]]] = {}
        asked: dict[str, dict[int | str, set[str]]] = {}
        for term in world.goal.terms:
            if len(term.ids) == 2:
                self._pairs.setdefault(term.predicate, set()).add(term.args)
            for identifier in term.ids:
                asked.setdefault(kind_of[identifier], {}).setdefault(identifier, set())
            if len(term.ids) == 1 and term.predicate in prepared:
                asked[kind_of[term.ids[0]]][term.ids[0]].add(term.predicate)
        self._wanted = {
            kind: set.intersection(*each.values()) for kind, each in asked.items() if each
        }

    def contradiction(self, atom: Atom, state: State) -> Subcategory | None:
        """Return how a pair of joined things contradicts the goal, if it does.

        A thing is unprepared if it lacks a predicate that all things of its kind need in the goal.
        """
        kinds = tuple(self._world.thing(name).kind for name in atom[1:])
        first = kinds[0]
        if first in {t.kind for t in self._world.placed} and first not in self._kinds:
            return Subcategory.INGREDIENT
        # The lower thing may lie unprepared on a table, where nothing was joined before.
        if any(
            not state.holds(predicate, name)
            for kind, name in zip(kinds, atom[1:], strict=True)
            for predicate in self._wanted.get(kind, ())
        ):
            return Subcategory.INGREDIENT
        pairs = self._pairs.get(atom[0])
        if pairs and kinds not in pairs and {k for pair in pairs for k in pair} >= set(kinds):
            return Subcategory.ORDER
        return None


def ingredients(world: World) -> frozenset[str]:
    """Return the kinds of existing items and containers that the goal names."""
    domain = world.task.domain
    places = {*domain.station_types, *domain.player_types}
    there = {thing.kind for thing in world.placed if thing.type not in places}
    return frozenset(k for t in world.goal.terms for k in t.args) & there


def prepared_predicates(world: World) -> frozenset[str]:
    """Return the lasting predicates that special effects add, such as `iscut`."""
    found = set()
    for schema in world.schemas:
        stack = list(schema.definition.sfx)
        while stack:
            effect = stack.pop()
            stack += effect.sfx
            if effect.counts:
                found |= {f.predicate for f in effect.fx if f.is_true and len(f.params) == 1}
    return frozenset(found)
