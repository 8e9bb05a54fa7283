"""Who stands where, and which conditions are about that."""

from __future__ import annotations

from functools import cached_property

from robotouille.world.scene import scene
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State, World

__all__ = ["Occupancy"]


class Occupancy:
    """What a domain's rules say of standing at stations: of which there are predicates that hold
    of a player at its place, and those that end when somebody walks there."""

    def __init__(self, world: World) -> None:
        self._world = world

    def is_about_standing(self, predicate: str) -> bool:
        """Whether a predicate says that somebody, or nobody, stands somewhere."""
        return predicate in self._standing or predicate in self._free

    def needed_free(self, unmet: Unmet) -> str | None:
        """The station at which nobody should stand, if that is the reason."""
        if unmet.kind is not UnmetKind.CONDITION or len(unmet.objects) != 1:
            return None
        return unmet.objects[0] if self._free.get(unmet.predicate) == unmet.expected else None

    def players_at(self, state: State, station: str) -> list[str]:
        """Who stands at a station."""
        return [name for name, each in scene(state).items() if each.at == station]

    @cached_property
    def _standing(self) -> frozenset[str]:
        layout = self._world.task.domain.layout or ()
        return frozenset(rule.predicate for rule in layout if rule.when == "faces")

    @cached_property
    def _free(self) -> dict[str, bool]:
        """The predicates of a station that a walk there changes, and what they are before."""
        found: dict[str, bool] = {}
        for schema in self._world.schemas:
            travel = schema.definition.travel
            for effect in schema.definition.immediate_fx if travel else ():
                if travel and effect.params == (travel[1],):
                    found[effect.predicate] = not effect.is_true
        return found
