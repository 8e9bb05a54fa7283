"""Work that must be done first: actions that make a fact true, or make the object of a fact.

The work is read from a domain's special effects, which take time or repetitions. Actions with an
immediate result, such as putting an object down, need no mention.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

from robotouille.domain.schema import Condition, Conditional, CreatedObject, Creation, EffectDef
from robotouille.world.grounding.actions import ActionSchema
from robotouille.world.world import State, World


@dataclass(frozen=True, slots=True)
class Work:
    """Action that makes a fact true, with the parameters the fact decides.

    `places` are the stations where the action can be done; empty if any station will do.
    """

    schema: ActionSchema
    binding: Mapping[str, str]
    places: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Maker:
    """Action that makes a fact true later, with that effect's conditions and created object."""

    schema: ActionSchema
    fact: Condition
    needs: tuple[Condition, ...]
    created: CreatedObject | None


class Preparation:
    """Index of the work in one world. `preparation_of` caches the index of each world."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._table = world.table

    def creates(self, type_name: str) -> bool:
        """Return whether some work creates objects of a type."""
        return type_name in self._created

    def can_become(self, predicate: str, objects: Sequence[str]) -> bool:
        """Return whether any action can make a fact true."""
        at_once = any(
            effect.predicate == predicate and effect.is_true
            for schema in self._world.schemas
            for effect in schema.definition.immediate_fx
        )
        return at_once or any(self._bindings(predicate, objects))

    def work_for(self, predicate: str, objects: Sequence[str | None]) -> Work | None:
        """Return the work that makes a fact true, or None.

        Args:
            objects: Objects of the fact. None stands for the object that the work creates.
        """
        for maker, binding in self._bindings(predicate, objects):
            return Work(maker.schema, binding, tuple(self._places(maker.schema, binding)))
        return None

    def is_under_way(self, state: State, work: Work) -> bool:
        """Return whether work has been started and goes on by itself."""
        things = set(work.binding.values())
        return any(
            row.action == work.schema.name and row.running and row.timed
            and things <= {row.subject, *row.arguments}
            for row in state.progress()
        )  # fmt: skip

    @cached_property
    def _makers(self) -> tuple[_Maker, ...]:
        return tuple(maker for schema in self._world.schemas for maker in _makers_of(schema))

    @cached_property
    def _created(self) -> frozenset[str]:
        return frozenset(each.created.type for each in self._makers if each.created)

    def _bindings(
        self, predicate: str, objects: Sequence[str | None]
    ) -> Iterator[tuple[_Maker, dict[str, str]]]:
        """Yield the makers of a fact, with the parameters that the fact decides."""
        for maker in self._makers:
            fact, made = maker.fact, maker.created
            if fact.predicate != predicate or len(fact.params) != len(objects):
                continue
            binding: dict[str, str] = {}
            fits = True
            for parameter, name in zip(fact.params, objects, strict=True):
                if made is not None and parameter == made.param:
                    fits &= name is None or self._world.thing(name).kind == made.name
                elif name is None:
                    fits = False
                else:
                    binding[parameter] = name
            if fits and self._may_be_done(maker, binding):
                yield maker, binding

    def _may_be_done(self, maker: _Maker, binding: Mapping[str, str]) -> bool:
        """Return whether no static condition rules the work out."""
        for condition in (*maker.schema.definition.precons, *maker.needs):
            if condition.predicate not in self._table.static_predicates:
                continue
            if all(parameter in binding for parameter in condition.params):
                atom = (condition.predicate, *(binding[each] for each in condition.params))
                if (atom in self._table.static) != condition.is_true:
                    return False
        return True

    def _places(self, schema: ActionSchema, binding: Mapping[str, str]) -> Iterator[str]:
        """Yield the stations for an action that needs a particular kind of station."""
        stations = self._world.floor.stations
        needs = {
            each.predicate
            for each in schema.definition.precons
            if each.predicate in self._table.static_predicates
            and each.is_true and len(each.params) == 1 and each.params[0] not in binding
        }  # fmt: skip
        for name in stations:
            if any((predicate, name) in self._table.static for predicate in needs):
                yield name


@lru_cache(maxsize=8)
def preparation_of(world: World) -> Preparation:
    """Return the index of a world's work."""
    return Preparation(world)


def _makers_of(schema: ActionSchema) -> Iterator[_Maker]:
    def within(
        effects: Iterable[EffectDef], needs: tuple[Condition, ...], made: CreatedObject | None
    ) -> Iterator[_Maker]:
        for effect in effects:
            more = needs + (effect.conditions if isinstance(effect, Conditional) else ())
            new = effect.created_obj if isinstance(effect, Creation) else made
            for fact in effect.fx:
                if fact.is_true:
                    yield _Maker(schema, fact, more, new)
            yield from within(effect.sfx, more, new)

    yield from within(schema.definition.sfx, (), None)
