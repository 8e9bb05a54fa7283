"""The parts of a kitchen, and the kinds of objects that a generator can add."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache

from robotouille.domain.derived import fluents
from robotouille.domain.json_files import read_model
from robotouille.domain.loading import task_names
from robotouille.domain.schema import DomainFile, ObjectDef, ProblemFile
from robotouille.domain.task import Task
from robotouille.errors import FileError
from robotouille.generation.parameters import SeededRng
from robotouille.installation import data_folder
from robotouille.world.lint import lint_task


@dataclass(frozen=True, slots=True)
class Roles:
    """The types of a domain by the use of their objects.

    `placeable` objects stand on stations, `holdable` ones can be in a player's hands, and
    `stackable` ones can be on each other. `vessels` are placeable objects with contents. All other
    objects that are neither stations nor players (fillings) move with their vessel.
    """

    stations: tuple[str, ...]
    players: tuple[str, ...]
    placeable: tuple[str, ...]
    holdable: tuple[str, ...]
    stackable: tuple[str, ...]
    vessels: tuple[str, ...]

    @staticmethod
    def of(domain: DomainFile) -> Roles:
        """Return the roles of a domain's types, from its layout rules and predicates."""
        types = {p.name: p.param_types for p in domain.predicate_defs}
        stations, players = domain.station_types, domain.player_types
        movable = [t for t in domain.object_types if t not in (*stations, *players)]
        rules = domain.layout or ()
        shared = [types[r.predicate] for r in rules if r.when == "shares_tile"]
        stacked = [types[r.predicate] for r in rules if r.when == "next_in_stack"]
        pairs = [pair for pair in types.values() if len(pair) == 2]

        def shares(kind: str, hosts: tuple[str, ...]) -> bool:
            return any(kind in pair and any(h in pair for h in hosts) for pair in shared)

        def contains(kind: str) -> bool:
            return any(kind == b != a and a in movable for a, b in pairs)

        placeable = tuple(t for t in movable if shares(t, stations))
        return Roles(
            stations=stations,
            players=players,
            placeable=placeable,
            holdable=tuple(t for t in movable if shares(t, players)),
            stackable=tuple(t for t in placeable if (t, t) in stacked),
            vessels=tuple(t for t in placeable if contains(t)),
        )


Key = tuple[str, int]
"""A type and a position in the problem's list of that type."""

Tile = tuple[int, int]


@dataclass(frozen=True, slots=True)
class PlacedObject:
    """An object of a problem with its key."""

    type: str
    number: int
    definition: ObjectDef

    @property
    def key(self) -> Key:
        return (self.type, self.number)

    @property
    def tile(self) -> Tile:
        return (self.definition.x, self.definition.y)

    @property
    def target(self) -> Tile:
        """Tile in front of a player."""
        dx, dy = self.definition.direction or (0, 0)
        return (self.definition.x + dx, self.definition.y + dy)

    def __str__(self) -> str:
        return self.definition.name


@dataclass(frozen=True, slots=True)
class StackItem:
    """A unit that moves as a whole: an item, or a vessel with its contents."""

    thing: PlacedObject
    fillings: tuple[PlacedObject, ...] = ()


class ProblemParts:
    """The objects of a task by role.

    `carrier` contains the station or player of each movable object, `faces` the station of each
    player.

    Raises:
        FileError: The linter finds an error in the task.
    """

    def __init__(self, task: Task, roles: Roles) -> None:
        errors = [fault for fault in lint_task(task) if fault.severity == "error"]
        if errors:
            raise FileError(task.source or task.name, errors)
        self.task = task
        self.roles = roles
        self.things = tuple(
            PlacedObject(type_, number, definition)
            for type_ in task.domain.object_types
            for number, definition in enumerate(task.problem.objects.get(type_, ()))
        )
        self.stations = [t for t in self.things if t.type in roles.stations]
        self.players = [t for t in self.things if t.type in roles.players]
        fixed = {*roles.stations, *roles.players}
        self.movables = [t for t in self.things if t.type not in fixed]
        station_at = {s.tile: s.key for s in self.stations}
        host_at = {**{p.tile: p.key for p in self.players}, **station_at}
        self.carrier = {thing.key: host_at[thing.tile] for thing in self.movables}
        self.faces = {player.key: station_at[player.target] for player in self.players}

    def count(self, type_: str) -> int:
        """Return the number of objects of a type."""
        return len(self.task.problem.objects.get(type_, ()))

    def pieces(self) -> list[StackItem]:
        """Return all units that can move on their own."""
        fillings: dict[Key, list[PlacedObject]] = {}
        whole: list[PlacedObject] = []
        for thing in self.movables:
            vessel = self._vessel_of(thing)
            if vessel is None:
                whole.append(thing)
            else:
                fillings.setdefault(vessel.key, []).append(thing)
        return [StackItem(thing, tuple(fillings.get(thing.key, ()))) for thing in whole]

    def _vessel_of(self, thing: PlacedObject) -> PlacedObject | None:
        """Return the vessel of a filling, or None for other objects."""
        if thing.type in self.roles.placeable:
            return None
        return next(
            (v for v in self.movables if v.tile == thing.tile and v.type in self.roles.placeable),
            None,
        )


RARELY = 1 / 8
"""Probability that an irrelevant item is a vessel."""

Traits = dict[tuple[str, str], tuple[str, ...]]
"""For each type and kind, the predicates that all its objects have in problem files."""

Choice = tuple[str, str]
"""A type and one of its kinds."""


class Stock:
    """The kinds of stations and items in a task's domain.

    If the domain file lists no kinds, the task's kinds are used. An added object has the predicates
    that all objects of its kind have in the task, such as that an item can be cut. If the task has
    none of the kind, the shipped tasks of the domain count. Among these, prepared objects (such as
    cooked ones) count only if all of the kind are prepared.
    """

    def __init__(self, task: Task, roles: Roles) -> None:
        self._own = _traits([task.problem])
        self._shipped = _shipped_traits(task.domain.name, fluents(task.domain))
        self._known = {p.name: p.param_types for p in task.domain.predicate_defs}
        plain = [t for t in roles.placeable if t not in roles.vessels]
        self.stations = self._choices(task, roles.stations)
        self._plain = self._choices(task, plain)
        self._vessels = self._choices(task, roles.vessels)

    def _choices(self, task: Task, types: Iterable[str]) -> list[Choice]:
        return [(t, kind) for t in types for kind in self._kinds(task, t)]

    def _kinds(self, task: Task, type_: str) -> tuple[str, ...]:
        placed = dict.fromkeys(kind for t, kind in self._own if t == type_)
        return task.domain.kinds.get(type_) or tuple(placed)

    @property
    def has_items(self) -> bool:
        return bool(self._plain or self._vessels)

    def station(self, rng: SeededRng) -> tuple[str, ObjectDef]:
        """Return the type and definition of an irrelevant station without a place."""
        return self._made(rng.one_of(self.stations))

    def item(self, rng: SeededRng) -> tuple[str, ObjectDef]:
        """Return the type and definition of an irrelevant item, rarely a vessel."""
        rare = rng.happens(RARELY)
        pool = self._vessels if (rare and self._vessels) or not self._plain else self._plain
        return self._made(rng.one_of(pool))

    def _made(self, choice: Choice) -> tuple[str, ObjectDef]:
        type_, kind = choice
        traits = self._own.get(choice, self._shipped.get(choice, ()))
        fitting = tuple(name for name in traits if self._known.get(name) == (type_,))
        return type_, ObjectDef(name=kind, x=0, y=0, predicates=fitting)


def _traits(problems: Iterable[ProblemFile], prepared: frozenset[str] = frozenset()) -> Traits:
    """Return the common predicates of the objects of each kind.

    Args:
        prepared: Predicates of prepared objects, which count only if all objects of the kind have
            one.
    """
    common: Traits = {}
    common_prepared: Traits = {}
    for problem in problems:
        for type_, things in problem.objects.items():
            for thing in things:
                found = common if prepared.isdisjoint(thing.predicates) else common_prepared
                before = found.setdefault((type_, thing.name), thing.predicates)
                found[type_, thing.name] = tuple(p for p in before if p in thing.predicates)
    return common_prepared | common


@cache
def _shipped_traits(domain: str, changeable: frozenset[str]) -> Traits:
    """Return the common predicates of all shipped objects before any action."""
    return _traits(_shipped_problems(domain), changeable)


def _shipped_problems(domain: str) -> Iterator[ProblemFile]:
    """Yield the handwritten problems of a domain, without generated ones."""
    folder = data_folder("problems")
    for name in task_names():
        problem = read_model(folder / f"{name}.json", ProblemFile)
        if (problem.domain or "robotouille") == domain and problem.provenance is None:
            yield problem
