"""Roles of a domain's types and predicates, derived from its definitions alone.

Objects are players, stations, or *movables* (everything else). A walk is any action that changes
nothing but its player's place. Nothing here is specific to kitchens.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

from robotouille.domain.schema import Condition, Creation, EffectDef
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.atoms import EXISTS, USED, bits_of
from robotouille.world.grounding.objects import Atom
from robotouille.world.world import World

SOMEBODY = "@"
"""First letter of the placeholder for any player of a crew in the atoms of a projection."""


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
        self.crews: dict[str, list[str]] = {}
        self._crew: dict[str, str] = {}
        self._reached: dict[str, frozenset[str]] = {}
        for player in world.players:
            reached = world.reached_by(player)
            known = next((c for c, found in self._reached.items() if found == reached), None)
            crew = known or f"{SOMEBODY}{len(self.crews)}"
            self._reached[crew], self._crew[player] = reached, crew
            self.crews.setdefault(crew, []).append(player)

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

    def crew_of(self, player: str) -> str:
        """Return the placeholder for a player and all who can walk to the same stations."""
        return self._crew[player]

    def crews_at(self, station: str) -> int:
        """Return the number of crews that can walk to a station."""
        return sum(station in reached for reached in self._reached.values())

    def can_stand(self, conditions: Iterable[Condition], binding: dict[str, str]) -> bool:
        """Return whether the crews of a binding can walk to where the conditions place them."""
        return all(
            binding[station] in self._reached[binding[player]]
            for c in conditions
            if c.predicate in self.place_predicates and c.is_true
            for player in c.params
            if binding[player] in self._reached
            for station in c.params
            if station != player
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

    def above(self, facts: int) -> dict[str, str]:
        """Return what lies directly on each object."""
        rules = self.world.task.domain.layout or ()
        table = self.world.table
        return {
            table.atoms[i][2]: table.atoms[i][1]
            for rule in rules
            if rule.when == "next_in_stack"
            for i in bits_of(facts & table.matching((rule.predicate, None, None)))
        }

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
        return self.crews.get(value) or self.classes.get(value, [value])

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
