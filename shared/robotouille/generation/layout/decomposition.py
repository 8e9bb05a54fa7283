"""A problem taken apart: its stations, who stands at them, and what stands on them."""

from __future__ import annotations

from dataclasses import dataclass

from robotouille.domain.schema import ObjectDef
from robotouille.domain.task import Task
from robotouille.errors import FileError
from robotouille.generation.layout.type_roles import Roles
from robotouille.world.lint import lint_task

__all__ = ["Key", "ProblemParts", "StackItem", "Thing"]

Key = tuple[str, int]
"""A type, and a position in the problem's list of that type."""

Tile = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Thing:
    """An object of a problem: its key, and what it is like."""

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
        """The tile in front of a player."""
        dx, dy = self.definition.direction or (0, 0)
        return (self.definition.x + dx, self.definition.y + dy)

    def __str__(self) -> str:
        return self.definition.name


@dataclass(frozen=True, slots=True)
class StackItem:
    """What moves as one: an item, or a vessel with all that is in it."""

    thing: Thing
    fillings: tuple[Thing, ...] = ()


class ProblemParts:
    """A task taken apart; FileError if the linter finds an error in it.

    `carrier` says on which station or with which player each movable thing is, `faces` at which
    station each player stands.
    """

    def __init__(self, task: Task, roles: Roles) -> None:
        errors = [fault for fault in lint_task(task) if fault.severity == "error"]
        if errors:
            raise FileError(task.source or task.name, errors)
        self.task = task
        self.roles = roles
        self.things = tuple(
            Thing(type_, number, definition)
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
        """How many objects of a type there are."""
        return len(self.task.problem.objects.get(type_, ()))

    def pieces(self) -> list[StackItem]:
        """All that can be moved on its own."""
        fillings: dict[Key, list[Thing]] = {}
        whole: list[Thing] = []
        for thing in self.movables:
            vessel = self._vessel_of(thing)
            if vessel is None:
                whole.append(thing)
            else:
                fillings.setdefault(vessel.key, []).append(thing)
        return [StackItem(thing, tuple(fillings.get(thing.key, ()))) for thing in whole]

    def _vessel_of(self, thing: Thing) -> Thing | None:
        """What a filling is in; None for what stands by itself."""
        if thing.type in self.roles.placeable:
            return None
        return next(
            (v for v in self.movables if v.tile == thing.tile and v.type in self.roles.placeable),
            None,
        )
