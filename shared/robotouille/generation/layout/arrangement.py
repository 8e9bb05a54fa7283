"""Which thing goes on which station, which player to which: everything but the tiles."""

from __future__ import annotations

from dataclasses import dataclass, field

from robotouille.domain.schema import ObjectDef
from robotouille.generation.layout.decomposition import Key, ProblemParts, StackItem, Thing
from robotouille.generation.layout.stock import Stock
from robotouille.generation.layout.type_roles import Roles
from robotouille.generation.parameters import (
    MAX_OBJECTS,
    Amounts,
    AttemptError,
    GenerationError,
    Kind,
    Parameters,
)
from robotouille.generation.rng import SeededRng

__all__ = ["Arrangement", "arrange"]

HOLDS = 1 / 2
"""How likely a player holds something where players may."""


@dataclass(slots=True)
class Arrangement:
    """All things, those of the original first; what carries each and at which level of a stack;
    and at which station each player stands."""

    things: list[Thing]
    carrier: dict[Key, tuple[Key, int]] = field(default_factory=dict)
    faces: dict[Key, Key] = field(default_factory=dict)

    def put(self, piece: StackItem, host: Key, level: int = 0) -> None:
        """Put something, with what is in it, on a station or into a player's hands."""
        self.carrier[piece.thing.key] = (host, level)
        for filling in piece.fillings:
            self.carrier[filling.key] = (host, filling.definition.stack_level)


def arrange(
    parts: ProblemParts, stock: Stock, kind: Kind, parameters: Parameters, rng: SeededRng
) -> Arrangement:
    """One arrangement of a kitchen; AttemptError where things do not fit."""
    amounts = Amounts.of(parameters, kind, rng)
    if amounts.items and not stock.has_items:
        raise AttemptError("items", "the domain has no kind of item that stands on a station")
    total = len(parts.things) + amounts.stations + amounts.items
    if total > MAX_OBJECTS:
        name = "stations" if amounts.stations > amounts.items else "items"
        raise GenerationError(name, f"{total} objects in all; at most {MAX_OBJECTS} are allowed")
    added = _Added(parts)
    stations = [added.make(*stock.station(rng)) for _ in range(amounts.stations)]
    pieces = [StackItem(added.make(*stock.item(rng))) for _ in range(amounts.items)]
    things = [*parts.things, *stations, *(piece.thing for piece in pieces)]
    arrangement = Arrangement(things)
    stacks = parameters.stacks(kind)
    if kind is Kind.NOISY:
        _keep(parts, arrangement)
        shelves = _Shelves(stations, parts.roles, stacks, arrangement)
        shelves.fill(pieces, rng)
        return arrangement
    everywhere = [*parts.stations, *stations]
    for player, station in zip(parts.players, rng.shuffled(everywhere), strict=False):
        arrangement.faces[player.key] = station.key
    loose = rng.shuffled([*parts.pieces(), *pieces])
    if parameters.held:
        loose = _hand_out(parts, arrangement, loose, rng)
    _Shelves(everywhere, parts.roles, stacks, arrangement).fill(loose, rng)
    return arrangement


def _keep(parts: ProblemParts, arrangement: Arrangement) -> None:
    """Leave everything with the station or player it is with."""
    for thing in parts.movables:
        arrangement.put(StackItem(thing), parts.carrier[thing.key], thing.definition.stack_level)
    arrangement.faces.update(parts.faces)


def _hand_out(
    parts: ProblemParts, arrangement: Arrangement, pieces: list[StackItem], rng: SeededRng
) -> list[StackItem]:
    """Give some players something to hold; returns what is left."""
    left = list(pieces)
    for player in parts.players:
        holdable = [piece for piece in left if piece.thing.type in parts.roles.holdable]
        if holdable and rng.happens(HOLDS):
            left.remove(holdable[0])
            arrangement.put(holdable[0], player.key)
    return left


class _Added:
    """Makes things that the original does not have; they come after its own."""

    def __init__(self, parts: ProblemParts) -> None:
        self._counts = {t: parts.count(t) for t in parts.task.domain.object_types}

    def make(self, type_: str, definition: ObjectDef) -> Thing:
        number = self._counts[type_]
        self._counts[type_] += 1
        return Thing(type_, number, definition)


class _Shelves:
    """Stations to put things on: one each, or a stack of one type."""

    def __init__(
        self, stations: list[Thing], roles: Roles, stacks: bool, arrangement: Arrangement
    ) -> None:
        self._stackable = roles.stackable if stacks else ()
        self._arrangement = arrangement
        self._stacks: dict[Key, list[StackItem]] = {station.key: [] for station in stations}

    def fill(self, pieces: list[StackItem], rng: SeededRng) -> None:
        """Put everything somewhere, first what needs a station for itself."""
        for piece in sorted(pieces, key=lambda p: p.thing.type in self._stackable):
            fitting = [key for key, stack in self._stacks.items() if self._fits(piece, stack)]
            if not fitting:
                alone = sum(p.thing.type not in self._stackable for p in pieces)
                message = (
                    f"{len(pieces)} things, {alone} of which need a station for themselves, "
                    f"do not fit on {len(self._stacks)} stations"
                )
                raise AttemptError("items", message)
            key = rng.one_of(fitting)
            self._arrangement.put(piece, key, len(self._stacks[key]))
            self._stacks[key].append(piece)

    def _fits(self, piece: StackItem, stack: list[StackItem]) -> bool:
        type_ = piece.thing.type
        return not stack or (type_ in self._stackable and stack[0].thing.type == type_)
