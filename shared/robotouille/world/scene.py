"""The place of every object in a state, by applying the domain's layout rules in reverse.

The window draws scenes. This module does not depend on pygame or on time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from robotouille.world.grounding.objects import Object, Tile
from robotouille.world.world import State, World


@dataclass(frozen=True, slots=True)
class Placed:
    """One object of a scene.

    Attributes:
        thing: The object.
        tile: Tile of the object or of its host.
        host: The station, player or container that carries the object; None for stations and
            players.
        level: Number of objects below it in its stack.
        facing: Unit vector of a player's direction.
        at: The station where a player is.
        facts: Unary predicates that hold of the object.
        contents: Items that are in some relation to the object and have no other place.
    """

    thing: Object
    tile: Tile | None
    host: str | None = None
    level: int = 0
    facing: tuple[int, int] | None = None
    at: str | None = None
    facts: frozenset[str] = frozenset()
    contents: tuple[str, ...] = ()


def scene(state: State) -> dict[str, Placed]:
    """Return every object of a state by name, with its place.

    Results are cached for a few states; do not modify them.
    """
    return _scene(state.world, state)


@lru_cache(maxsize=8)
def _scene(_: World, state: State) -> dict[str, Placed]:
    """Return a scene. The world is part of the cache key: states of two worlds can be equal."""
    return _Scene(state).placed()


class _Scene:
    def __init__(self, state: State) -> None:
        self._state = state
        self._world = state.world
        domain = state.world.task.domain
        self._stations = set(domain.station_types)
        self._players = set(domain.player_types)
        when = {rule.predicate: rule.when for rule in domain.layout or () if rule.when}
        self._at: dict[str, str] = {}
        self._host: dict[str, str] = {}
        self._below: dict[str, str] = {}
        self._facts: dict[str, set[str]] = {}
        self._related: dict[str, list[str]] = {}
        for atom in state.atoms():
            match when.get(atom[0]):
                case "faces":
                    self._at[atom[1]] = atom[2]
                case "shares_tile":
                    self._carry(atom[1], atom[2])
                case "next_in_stack":
                    self._below[atom[1]] = atom[2]
                case _ if len(atom) == 2:
                    self._facts.setdefault(atom[1], set()).add(atom[0])
                case "bottom_of_stack" | "reaches":
                    pass
                case _ if len(atom) > 2:
                    self._related.setdefault(atom[-1], []).append(atom[1])

    def _carry(self, first: str, second: str) -> None:
        """Record which of two objects on a tile carries the other."""
        if self._world.thing(first).type in self._players | self._stations:
            first, second = second, first
        self._host[first] = second

    def placed(self) -> dict[str, Placed]:
        result: dict[str, Placed] = {}
        standing = self._standing()
        for thing in self._state.objects:
            tile = thing.tile if thing.type in self._stations else standing.get(thing.name)
            result[thing.name] = Placed(
                thing=thing,
                tile=tile,
                host=self._host.get(thing.name),
                level=self._level(thing.name),
                facing=self._facing(thing, tile),
                at=self._at.get(thing.name),
                facts=frozenset(self._facts.get(thing.name, ())),
                contents=tuple(n for n in self._related.get(thing.name, ()) if n not in self._host),
            )
        return {name: self._with_tile(placed, result) for name, placed in result.items()}

    def _with_tile(self, placed: Placed, all_: dict[str, Placed]) -> Placed:
        host = placed.host
        tile = placed.tile
        # The loop is bounded because custom domains can have cyclic relations.
        for _ in range(len(all_)):
            if tile is not None or host is None or host not in all_:
                break
            tile, host = all_[host].tile, all_[host].host
        return Placed(
            placed.thing, tile, placed.host, placed.level, placed.facing, placed.at,
            placed.facts, placed.contents,
        )  # fmt: skip

    def _level(self, name: str) -> int:
        # A custom domain can put objects on each other in a circle, so visited ones are tracked.
        level, seen = 0, {name}
        while (name := self._below.get(name, "")) and name not in seen:
            seen.add(name)
            level += 1
        return level

    def _standing(self) -> dict[str, Tile]:
        """Return each player's tile next to its station, different from others if possible."""
        taken: dict[str, Tile] = {}
        for name in self._world.players:
            thing, station = self._world.thing(name), self._at.get(name)
            floor = self._world.floor
            choices = floor.beside(station) if station else []
            if thing.tile:
                # A counter can be used from both sides, but the player is on one.
                choices = floor.connected(thing.tile, choices) or choices
            # A player that has not moved stays where the problem puts it.
            if thing.tile and (not station or self._world.thing(station).tile == thing.facing):
                choices = [thing.tile, *choices]
            if not choices:
                continue
            free = [tile for tile in choices if tile not in taken.values()]
            taken[name] = (free or choices)[0]
        return taken

    def _facing(self, thing: Object, tile: Tile | None) -> tuple[int, int] | None:
        if thing.type not in self._players or tile is None:
            return None
        station = self._at.get(thing.name)
        there = self._world.thing(station).tile if station else None
        if there is None or there == tile:
            return (0, -1)
        dx, dy = there[0] - tile[0], there[1] - tile[1]
        # A custom domain can have a player at a distant station; it faces the longer way.
        if abs(dx) > abs(dy):
            return (1 if dx > 0 else -1, 0)
        return (0, 1 if dy > 0 else -1)
