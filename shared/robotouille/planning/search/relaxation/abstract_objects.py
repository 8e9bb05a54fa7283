"""The objects of a relaxation: those that exist, and one that stands for all yet to be created."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from robotouille.domain.schema import Creation, EffectDef
from robotouille.world.world import World

__all__ = ["AbstractObject", "AbstractObjects", "abstract_objects", "future_name"]


@dataclass(frozen=True, slots=True)
class AbstractObject:
    """An object by name, kind and type; `future` if it stands for all that will be created."""

    name: str
    kind: str
    type: str
    future: bool


@dataclass(frozen=True)
class AbstractObjects:
    """Who takes part in a relaxation."""

    members: tuple[AbstractObject, ...]

    @cached_property
    def by_name(self) -> dict[str, AbstractObject]:
        return {member.name: member for member in self.members}

    @cached_property
    def future(self) -> frozenset[str]:
        """The names that stand for objects yet to be created."""
        return frozenset(m.name for m in self.members if m.future)

    def of_type(self, kind: str) -> list[str]:
        return [m.name for m in self.members if m.type == kind]


def abstract_objects(world: World, facts: int) -> AbstractObjects:
    """The objects that exist in `facts`, and a future one of each kind that play can create."""
    present = [AbstractObject(o.name, o.kind, o.type, False) for o in world.objects_in(facts)]
    created = {
        (effect.created_obj.name, effect.created_obj.type)
        for schema in world.schemas
        for effect in _walk(schema.definition.sfx)
        if isinstance(effect, Creation)
    }
    future = [AbstractObject(future_name(kind, of), kind, of, True) for kind, of in sorted(created)]
    return AbstractObjects((*present, *future))


def future_name(kind: str, type_: str) -> str:
    """A name that no object has."""
    return f"{kind}+{type_}"


def _walk(effects: tuple[EffectDef, ...]) -> Iterator[EffectDef]:
    for effect in effects:
        yield effect
        yield from _walk(effect.sfx)
