"""The objects of a problem, their names, the facts that their positions imply, and the floor.

Objects of a kind are numbered by position (docs/file_formats.md, "Names"). The domain's `layout`
rules define the facts that follow from positions
(docs/decisions/0003-layout-and-delays-are-data.md).
"""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from robotouille.domain.problem_checks import object_place
from robotouille.domain.schema import Condition, LayoutRule, ObjectDef
from robotouille.domain.task import Task

Tile = tuple[int, int]
Atom = tuple[str, ...]
"""A ground predicate: its name, then the names of its arguments."""


def atom_name(atom: Atom) -> str:
    """Return an atom's name, such as `item_on(lettuce1, table2)`."""
    return f"{atom[0]}({', '.join(atom[1:])})"


def bound(condition: Condition, binding: Mapping[str, str]) -> Atom:
    """Return a condition with its parameters replaced by objects."""
    return (condition.predicate, *(binding[name] for name in condition.params))


@dataclass(frozen=True, slots=True)
class Object:
    """An object: `lettuce1` of kind `lettuce` and type `item`.

    `tile` is the object's place in the problem; None for objects created during play. `facing` is
    the tile in front of a player.
    """

    name: str
    kind: str
    type: str
    tile: Tile | None = None
    facing: Tile | None = None
    level: int = 0
    label: str | int | None = None
    predicates: tuple[str, ...] = ()


def place_objects(task: Task) -> tuple[Object, ...]:
    """Return all objects of a task, by type in the domain's order, then in the order of names."""
    return tuple(thing for thing, _ in _placed(task))


def places_in_problem(task: Task) -> dict[str, str]:
    """Return the place of each object in the problem, such as `objects.item[3]`, by its name."""
    return {thing.name: object_place(thing.type, index) for thing, index in _placed(task)}


def _placed(task: Task) -> Iterator[tuple[Object, int]]:
    """Yield all objects of a task, each with its index among those of its type in the problem."""
    for kind in task.domain.object_types:
        definitions = list(task.problem.objects.get(kind, ()))
        if kind in task.domain.player_types:
            # One problem file serves all numbers of seats: unused players are left out
            # (docs/decisions/0009-one-file-for-all-seat-counts.md).
            definitions = definitions[: task.seats]
        numbers: Counter[str] = Counter()
        for index in _numbered(definitions, task.problem.published):
            definition = definitions[index]
            numbers[definition.name] += 1
            yield _object(definition, kind, numbers[definition.name]), index


def _numbered(definitions: list[ObjectDef], published: bool) -> list[int]:
    """Return indexes in the order in which objects are numbered: by x, y and stack level."""

    def key(index: int) -> tuple[int, ...]:
        thing = definitions[index]
        # The published simulator ignores stack levels: on one tile, it numbers in the file's order.
        return (thing.x, thing.y) if published else (thing.x, thing.y, thing.stack_level)

    return sorted(range(len(definitions)), key=key)


def _object(definition: ObjectDef, kind: str, number: int) -> Object:
    tile = (definition.x, definition.y)
    facing = None
    if definition.direction is not None:
        dx, dy = definition.direction
        facing = (definition.x + dx, definition.y + dy)
    return Object(
        name=f"{definition.name}{number}",
        kind=definition.name,
        type=kind,
        tile=tile,
        facing=facing,
        level=definition.stack_level,
        label=definition.id,
        predicates=definition.predicates,
    )


def initial_facts(task: Task, objects: Iterable[Object]) -> frozenset[Atom]:
    """Return the initial facts: kinds, the problem's predicates, and what positions imply."""
    objects = tuple(objects)
    types = {p.name: p.param_types for p in task.domain.predicate_defs}
    facts: set[Atom] = set()
    for thing in objects:
        if types.get(f"is{thing.kind}") == (thing.type,):
            facts.add((f"is{thing.kind}", thing.name))
        facts.update((predicate, thing.name) for predicate in thing.predicates)
    rules = task.domain.layout or ()
    stations = set(task.domain.station_types)
    # Rules share the floor because it caches walks.
    floor = Floor(task.problem.width, task.problem.height, objects, stations)
    for rule in rules:
        if rule.when == "reaches":
            players = (o for o in objects if o.type == types[rule.predicate][0])
            facts.update((rule.predicate, *pair) for pair in floor.reaching(players))
        elif rule.when is not None:
            facts.update(_implied(rule, types[rule.predicate], objects, stations))
    # `unless` rules come last because they depend on the other facts.
    for rule in rules:
        if rule.unless is not None:
            facts.update(_default(rule, types, objects, facts))
    return frozenset(facts)


def _implied(
    rule: LayoutRule, types: tuple[str, ...], objects: tuple[Object, ...], stations: set[str]
) -> Iterator[Atom]:
    if rule.when in ("shares_tile", "faces"):
        for first in (o for o in objects if o.type == types[0]):
            tile = (first.facing or first.tile) if rule.when == "faces" else first.tile
            for second in objects:
                if second.type == types[1] and second.tile == tile and second is not first:
                    yield (rule.predicate, first.name, second.name)
        return
    for station, stack in _stacks(objects, types[0], stations):
        if rule.when == "bottom_of_stack":
            yield (rule.predicate, stack[0].name, station.name)
        elif rule.when == "top_of_stack":
            yield (rule.predicate, stack[-1].name)
        else:
            for below, above in pairwise(stack):
                yield (rule.predicate, above.name, below.name)


def _stacks(
    objects: tuple[Object, ...], kind: str, stations: set[str]
) -> Iterator[tuple[Object, list[Object]]]:
    """Yield each station that carries objects of a type, with the objects from the bottom up."""
    by_tile: defaultdict[Tile | None, list[Object]] = defaultdict(list)
    for thing in objects:
        if thing.type == kind:
            by_tile[thing.tile].append(thing)
    for station in objects:
        if station.type in stations and by_tile[station.tile]:
            yield station, sorted(by_tile[station.tile], key=lambda o: o.level)


def _default(
    rule: LayoutRule,
    types: dict[str, tuple[str, ...]],
    objects: tuple[Object, ...],
    facts: set[Atom],
) -> Iterator[Atom]:
    kind = types[rule.predicate][0]
    taken = {
        argument
        for fact in facts
        if fact[0] in (rule.unless or ())
        for argument, type_ in zip(fact[1:], types[fact[0]], strict=True)
        if type_ == kind
    }
    for thing in objects:
        if thing.type == kind and thing.name not in taken:
            yield (rule.predicate, thing.name)


# South comes first: there, a player who faces the station turns its back to the viewer.
_NEIGHBOURS = ((0, -1), (0, 1), (-1, 0), (1, 0))


class Floor:
    """Tiles of a grid without a station, and walks over them.

    Attributes:
        stations: The tile of each station.
        plain: Stations at which players only put things down, usually tables. This is the most
            frequent kind of station with an empty one at the beginning, so no crates.
    """

    def __init__(self, width: int, height: int, objects: tuple[Object, ...], stations: set[str]):
        self.width = width
        self.height = height
        self.stations = {o.name: o.tile for o in objects if o.type in stations and o.tile}
        self.plain = _plain(objects, stations)
        self.blocked = frozenset(self.stations.values())
        # Only players have a direction; their tiles are where walks begin.
        self._starts = tuple(o.tile for o in objects if o.facing is not None and o.tile)
        self._walks: dict[Tile, dict[Tile, Tile]] = {}

    def is_free(self, tile: Tile) -> bool:
        """Return whether a tile is on the grid and has no station."""
        x, y = tile
        return 0 <= x < self.width and 0 <= y < self.height and tile not in self.blocked

    @cached_property
    def reachable(self) -> frozenset[Tile]:
        """The free tiles that some player can reach from its start."""
        found: set[Tile] = set()
        for start in self._starts:
            if start not in found:
                found.update(self._walk_from(start))
        return frozenset(found)

    def beside(self, station: str) -> list[Tile]:
        """Return the reachable free tiles next to a station, the preferred one first."""
        x, y = self.stations[station]
        around = [(x + dx, y + dy) for dx, dy in _NEIGHBOURS]
        return [tile for tile in around if self.is_free(tile) and tile in self.reachable]

    def connected(self, start: Tile, tiles: Iterable[Tile]) -> list[Tile]:
        """Return the tiles to which one can walk from a free tile."""
        return [tile for tile in tiles if tile in self._walk_from(start)]

    def reaching(self, players: Iterable[Object]) -> Iterator[tuple[str, str]]:
        """Yield each player that has a start, with each station that it can walk to from there."""
        for player in players:
            if player.facing is not None and player.tile:
                for station in self.stations:
                    if self.connected(player.tile, self.beside(station)):
                        yield player.name, station

    def standing(self, station: str) -> Tile:
        """Return the tile from which a station is used, or its own tile if it is enclosed."""
        beside = self.beside(station)
        return beside[0] if beside else self.stations[station]

    def path(self, start: Tile, goal: Tile) -> list[Tile]:
        """Return a shortest walk with both ends; only the ends if none exists."""
        came_from = self._walk_from(goal)
        if start not in came_from:
            return [start, goal]
        path = [start]
        while path[-1] != goal:
            path.append(came_from[path[-1]])
        return path

    def distance(self, here: str, there: str) -> int:
        """Return the length of the walk between the tiles from which two stations are used."""
        start, goal = self.standing(here), self.standing(there)
        if start not in self._walk_from(goal):
            # A counter divides the floor, and one of the stations can be used from both sides.
            walks = (
                (a, b) for a in self.beside(here) for b in self.connected(a, self.beside(there))
            )
            start, goal = min(walks, key=lambda ends: len(self.path(*ends)), default=(start, goal))
        return len(self.path(start, goal)) - 1

    def _walk_from(self, goal: Tile) -> dict[Tile, Tile]:
        """Return the next tile on the way to `goal` for each tile from which it can be reached."""
        known = self._walks.get(goal)
        if known is None:
            known = {goal: goal}
            queue = deque([goal])
            while queue:
                x, y = tile = queue.popleft()
                for dx, dy in _NEIGHBOURS:
                    neighbour = (x + dx, y + dy)
                    if neighbour not in known and self.is_free(neighbour):
                        known[neighbour] = tile
                        queue.append(neighbour)
            # Searching backward from the goal answers all walks to it with one search.
            self._walks[goal] = known
        return known


def _plain(objects: Iterable[Object], types: set[str]) -> frozenset[str]:
    stations = [each for each in objects if each.type in types]
    used = {each.tile for each in objects if each.type not in types and each.facing is None}
    empty = {each.kind for each in stations if each.tile not in used}
    count = Counter(each.kind for each in stations if each.kind in empty or not empty)
    kinds = count.most_common(1)
    return frozenset(each.name for each in stations if each.kind == kinds[0][0])
