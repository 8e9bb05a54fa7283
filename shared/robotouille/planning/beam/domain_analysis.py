"""Roles of a domain's types and predicates, derived from its definitions alone.

Objects are players, stations, or *movables* (everything else). A walk is any action that changes
nothing but its player's place. Nothing here is specific to kitchens.
"""

from __future__ import annotations

from functools import cached_property

from robotouille.domain.schema import Condition, Creation, EffectDef
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.atoms import EXISTS, USED
from robotouille.world.grounding.objects import Atom
from robotouille.world.world import World

SOMEBODY = "@"
"""Placeholder for any player in the atoms of a projection."""


class DomainAnalysis:
    """Roles of the types, predicates and action schemas of a world's domain."""

    def __init__(self, world: World) -> None:
        self.world = world
        domain = world.task.domain
        self.player_types = frozenset(domain.player_types)
        self.station_types = frozenset(domain.station_types)
        placed = world.placed
        self.stations = tuple(o.name for o in placed if o.type in self.station_types)
        self._types = {p.name: p.param_types for p in domain.predicate_defs}
        walking = [s for s in world.schemas if self._walks(s)]
        self.walking = frozenset(s.name for s in walking)
        walked = {c.predicate for s in walking for c in s.definition.immediate_fx}
        self.walked = frozenset(walked)
        self.place_predicates = frozenset(p for p in walked if len(self._types[p]) == 2)
        self.classes: dict[str, list[str]] = {}
        self._class: dict[str, str] = {}

    def _walks(self, schema: ActionSchema) -> bool:
        effects = schema.definition.immediate_fx
        allowed = self.player_types | self.station_types
        types = [set(self._types[c.predicate]) for c in effects]
        return (
            schema.player
            and not schema.effects
            and bool(effects)
            and all(kinds <= allowed for kinds in types)
            and any(kinds & self.player_types and kinds & self.station_types for kinds in types)
        )

    def is_movable(self, kind: str) -> bool:
        """Return whether a type is neither a player's nor a station's."""
        return kind not in self.player_types and kind not in self.station_types

    def type_of(self, name: str) -> str:
        return self.world.thing(name).type

    def movables_in(self, atom: Atom) -> list[str]:
        """Return the movable objects of an atom in order."""
        return [n for n in atom[1:] if self.is_movable(self.type_of(n))]

    def stations_in(self, atom: Atom) -> list[str]:
        """Return the stations of an atom in order."""
        return [n for n in atom[1:] if self.type_of(n) in self.station_types]

    # Classes of movables that a projection need not distinguish

    @cached_property
    def _distinguishing(self) -> frozenset[str]:
        """Static predicates on which it depends what an action can do with a movable object."""
        found = set()
        for schema in self.world.schemas:
            movable = {n for n, kind in schema.parameters if self.is_movable(kind)}
            effects = schema.definition.immediate_fx
            about_stations = any(self._is_about_stations(c.predicate) for c in effects)
            if len(movable) > 1 or about_stations or creates(schema):
                found |= {
                    c.predicate
                    for c in schema.definition.precons
                    if c.predicate in self.world.table.static_predicates
                    and len(c.params) == 1
                    and c.params[0] in movable
                }
        return frozenset(found)

    def _is_about_stations(self, predicate: str) -> bool:
        return predicate not in self.walked and set(self._types[predicate]) <= self.station_types

    def class_of(self, name: str) -> str:
        """Return the placeholder for a movable object and all equivalent ones."""
        known = self._class.get(name)
        if known is None:
            static = self.world.table.static
            marks = sorted(p for p in self._distinguishing if (p, name) in static)
            known = self._class[name] = f"*{self.type_of(name)}:{','.join(marks)}"
            self.classes.setdefault(known, []).append(name)
        return known

    def classes_of(self, kind: str) -> list[str]:
        """Return the placeholders of a movable type, in order of their first member."""
        return list(dict.fromkeys(map(self.class_of, self.world.table.by_type[kind])))

    def static_holds(self, condition: Condition, binding: dict[str, str]) -> bool:
        """Return whether a static condition can hold for any members of its placeholders."""
        pools = [self._members(binding[name], name, condition) for name in condition.params]
        static = self.world.table.static
        return any(
            ((condition.predicate, *arguments) in static) == condition.is_true
            for arguments in _product(pools)
        )

    def _members(self, value: str, parameter: str, condition: Condition) -> list[str]:
        if value == SOMEBODY:
            return list(self.world.players)
        return self.classes.get(value, [value])

    # Time

    @cached_property
    def travel_to(self) -> dict[str, float]:
        """Mean number of steps of a walk to each station."""
        if not self.world.task.profile.steps_per_tile:
            return dict.fromkeys(self.stations, 1.0)
        floor, per_tile = self.world.floor, self.world.task.profile.steps_per_tile
        return {
            there: sum(
                max(1, floor.distance(here, there) * per_tile)
                for here in self.stations
                if here != there
            )
            / max(1, len(self.stations) - 1)
            for there in self.stations
        }

    @cached_property
    def mean_travel(self) -> float:
        """Mean number of steps of a walk."""
        return sum(self.travel_to.values()) / max(1, len(self.travel_to))

    @property
    def errand(self) -> float:
        """Mean number of steps of a walk and an action."""
        return 1.0 + self.mean_travel

    @cached_property
    def places(self) -> dict[str, int]:
        """For each player, the mask of the atoms about its place."""
        return {
            player: self.world.table.mask(
                (predicate, *pair)
                for predicate in sorted(self.place_predicates)
                for station in self.stations
                for pair in ((player, station), (station, player))
            )
            for player in self.world.players
        }

    @cached_property
    def place_mask(self) -> dict[str, int]:
        """For each station, the mask of the atoms that place a player there."""
        return {
            station: self.world.table.mask(
                (predicate, *pair)
                for predicate in sorted(self.place_predicates)
                for player in self.world.players
                for pair in ((player, station), (station, player))
            )
            for station in self.stations
        }

    # Objects that are created and deleted

    def exists(self, name: str, facts: int) -> bool:
        """Return whether an object exists in a state."""
        bit = self.world.table.bit.get((EXISTS, name))
        return bit is None or bool(facts & bit)

    def was_used(self, name: str, facts: int) -> bool:
        """Return whether an object exists or existed earlier."""
        bit = self.world.table.bit.get((USED, name))
        return bit is None or bool(facts & bit)

    def is_idle(self, action: GroundAction) -> bool:
        """Return whether an action only lets time pass."""
        return not action.touched and not action.effects


def creates(schema: ActionSchema) -> bool:
    """Return whether an action can create an object."""

    def inside(effects: tuple[EffectDef, ...]) -> bool:
        return any(isinstance(e, Creation) or inside(e.sfx) for e in effects)

    return inside(schema.definition.sfx)


def _product(pools: list[list[str]]) -> list[tuple[str, ...]]:
    result: list[tuple[str, ...]] = [()]
    for pool in pools:
        result = [(*head, value) for head in result for value in pool]
    return result
