"""Choice of a picture for each object of a state, and the order of objects in piles.

Pure functions: `SceneSprites` are computed once for each state from its scene and the rendering.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from robotouille.domain.art import Art, Facings, Fact
from robotouille.domain.rendering import Entity, RenderingFile
from robotouille.domain.schema import DomainFile, InputFile
from robotouille.world.grounding.objects import Object
from robotouille.world.scene import Placed, scene
from robotouille.world.world import State


@dataclass(frozen=True, slots=True)
class KitchenLook:
    """Rendering with its key bindings and the folder of its pictures."""

    rendering: RenderingFile
    bindings: InputFile
    pictures: Path


Role = Literal["station", "item", "container", "player"]

_SCALES: dict[Role, float] = {"station": 1.0, "item": 0.62, "container": 0.78, "player": 1.0}
_OFFSET = 0.16
_HEIGHT = 0.1


@dataclass(frozen=True, slots=True)
class Appearance:
    """Look of one object: a picture, or a generated tile with its kind and `words`.

    `effects` are the rendering's particle effects for this look.
    """

    kind: str
    role: Role
    asset: str | None = None
    words: str = ""
    facing: str = "front"
    effects: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class SpritePiece:
    """One object of a pile, with its look and its height above the pile's base in tiles.

    `inside` are the objects in it; `contents` were added to it or to those.
    """

    name: str
    appearance: Appearance
    scale: float
    rise: float
    contents: tuple[Appearance, ...] = ()
    inside: tuple[Appearance, ...] = ()


@dataclass(frozen=True, slots=True)
class SceneSprites:
    """Everything to draw of a state.

    Attributes:
        piles: Objects on each station or in each player's hands, from the bottom up.
        bases: Height of each pile's base above the middle of the tile.
        relations: Predicates that relate each object to others.
    """

    placed: dict[str, Placed]
    stations: dict[str, Appearance]
    piles: dict[str, tuple[SpritePiece, ...]]
    bases: dict[str, float]
    relations: dict[str, frozenset[str]]


class AppearanceResolver:
    """Chooses appearances from a domain's rendering file."""

    def __init__(self, domain: DomainFile, rendering: RenderingFile) -> None:
        self.rendering = rendering
        self._stations = set(domain.station_types)
        self._players = set(domain.player_types)
        self._words = _states_of_things(domain)
        self._pictured = rendering.traits()

    def stage(self, state: State) -> SceneSprites:
        """Return everything to draw of a state."""
        placed = scene(state)
        related, doing = _relations(state), _doing(state)
        stations, hosted = {}, defaultdict(list)
        for name, thing in placed.items():
            if thing.thing.type in self._stations:
                stations[name] = self.appearance(thing, placed, related, doing)
            elif self._is_inside(thing, placed):
                continue
            elif thing.host is not None:
                hosted[thing.host].append(thing)
            # An object on the bare floor is a pile of its own.
            elif thing.tile is not None and thing.thing.type not in self._players:
                hosted[name].append(thing)
        piles, bases = {}, {}
        for host, things in hosted.items():
            things.sort(key=lambda thing: thing.level)
            piles[host] = self._pile(things, placed, related, doing)
            bases[host] = self._constant(things[0].thing, "station_offset", _OFFSET)
        relations = {name: frozenset(fact[0] for fact in facts) for name, facts in related.items()}
        return SceneSprites(placed, stations, piles, bases, relations)

    def appearance(
        self,
        thing: Placed,
        placed: dict[str, Placed],
        related: dict[str, list[Fact]],
        doing: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
    ) -> Appearance:
        """Return the look of an object other than a player."""
        kind = thing.thing.kind
        entity = self._entity(kind)
        asset: str | None = None
        effects: tuple[str, ...] = ()
        if entity is not None:
            art, about = entity.assets, related.get(thing.thing.name, [])
            # A container may have pictures of its own for what is inside, such as a pot of soup.
            for meal in _inside(thing.thing.name, placed):
                group = art.named.get(meal.thing.kind)
                if group is not None and group.asset is None:
                    art, about = group, related.get(meal.thing.name, [])
                    break
            under_way = doing.get(thing.thing.name, {})
            shown = art.chosen(thing.facts, about, under_way)
            asset, effects = shown.at(under_way), shown.effects
        words = " ".join(sorted(w for f, w in self._words.items() if f in thing.facts))
        return Appearance(
            kind, self._role(thing.thing), asset, "" if asset else words, effects=effects
        )

    def pictured(self, stage: SceneSprites, name: str) -> Appearance | None:
        """Return the look of a station, a player or an object that is visible by itself."""
        if name in stage.stations:
            return stage.stations[name]
        pieces = (piece for pile in stage.piles.values() for piece in pile)
        found = next((piece.appearance for piece in pieces if piece.name == name), None)
        placed = stage.placed.get(name)
        if found is None and placed is not None and placed.thing.type in self._players:
            number = [n for n, p in stage.placed.items() if p.thing.type in self._players]
            return self.player(placed.thing.kind, number.index(name), "front")
        return found

    def listing(self, stage: SceneSprites, host: str) -> tuple[tuple[Appearance | None, str], ...]:
        """Return everything on a station or in a player's hands, from the top down, in words.

        Equal things one upon the other, such as the supply in a crate, are one entry.
        """
        listed: list[tuple[Appearance | None, str]] = []
        for piece in reversed(stage.piles.get(host, ())):
            listed.append((piece.appearance, self._in_words(stage, piece.name)))
            for inside, look in zip(_inside(piece.name, stage.placed), piece.inside, strict=True):
                listed.append(
                    (look if look.asset else None, self._in_words(stage, inside.thing.name))
                )
            names = _contents(piece.name, stage.placed)
            for name, appearance in zip(names, piece.contents, strict=True):
                listed.append((appearance, self._in_words(stage, name)))
        return tuple(
            (look, words if (count := len(list(same))) == 1 else f"{words} × {count}")
            for (look, words), same in groupby(listed)
        )

    def _in_words(self, stage: SceneSprites, name: str) -> str:
        thing = stage.placed[name]
        return self.words(thing.thing.kind, thing.facts | stage.relations.get(name, frozenset()))

    def words(self, kind: str, facts: Collection[str]) -> str:
        """Return what people call a kind and its state, such as `toasted bottom bun`."""
        known = self._pictured if self.rendering.shows(kind) else self._words
        states = sorted(
            self._words[fact] for fact in facts if fact in known and fact in self._words
        )
        names = self.rendering.language.kinds.get(kind, ())
        name = next((n.name for n in names if n.when is None or n.when in facts), kind)
        return " ".join([*states, name])

    def player(self, kind: str, index: int, facing: str, *, carrying: bool = False) -> Appearance:
        """Return the look of the player in seat `index` from one side."""
        facings = self._facings(kind, index)
        if facings is None:
            return Appearance(kind, "player", None, "", facing)
        sides = facings.carrying if carrying and facings.carrying is not None else facings
        return Appearance(kind, "player", getattr(sides, facing), "", facing)

    def cheering(self, kind: str, index: int) -> Appearance:
        """Return the look of a player with raised arms, or else from the front."""
        facings = self._facings(kind, index)
        if facings is None or facings.cheering is None:
            return self.player(kind, index, "front", carrying=True)
        return Appearance(kind, "player", facings.cheering, "", "front")

    def shut_eyes(self, kind: str, index: int, facing: str) -> str | None:
        """Return the picture of a player's shut eyes from one side, or None."""
        facings = self._facings(kind, index)
        if facings is None or facings.shut is None or facing == "back":
            return None
        file: str = getattr(facings.shut, facing)
        return file

    def feet(self, kind: str, index: int, facing: str) -> tuple[str, ...]:
        """Return the pictures of a player's stride from one side."""
        facings = self._facings(kind, index)
        frames: tuple[str, ...] = ()
        if facings is not None and facings.feet is not None:
            frames = getattr(facings.feet, facing)
        return frames

    def _facings(self, kind: str, index: int) -> Facings | None:
        looks = self.rendering.player
        choices = looks.get(kind) or next(iter(looks.values()), None)
        return choices[index % len(choices)] if choices else None

    def _pile(
        self,
        things: list[Placed],
        placed: dict[str, Placed],
        related: dict[str, list[Fact]],
        doing: Mapping[str, Mapping[str, float]],
    ) -> tuple[SpritePiece, ...]:
        pieces, rise = [], 0.0
        for thing in things:
            name = thing.thing.name
            scale = self.scale(thing.thing)
            contents, inside = (
                tuple(self.appearance(each, placed, related) for each in things)
                for things in (
                    [placed[n] for n in _contents(name, placed)],
                    _inside(name, placed),
                )
            )
            appearance = self.appearance(thing, placed, related, doing)
            pieces.append(SpritePiece(name, appearance, scale, rise, contents, inside))
            rise += self._constant(thing.thing, "stack_offset", _HEIGHT)
        return tuple(pieces)

    def _is_inside(self, thing: Placed, placed: dict[str, Placed]) -> bool:
        """Return whether an object is in a container, whose picture already shows it."""
        host = placed.get(thing.host or "")
        return host is not None and host.thing.type not in self._stations | self._players

    def scale(self, thing: Object) -> float:
        """Return the size in tiles at which an object is drawn."""
        return self._constant(thing, "scale", _SCALES[self._role(thing)])

    def pictures(self, thing: Object) -> dict[str, Art]:
        """Return all pictures an object may get, each with its `Art`; none for players."""
        entity = self._entity(thing.kind)
        found = [] if entity is None else [art for _, art in entity.assets.parts(thing.kind)]
        return {file: art for art in found for file in (art.asset, *art.stages) if file}

    def _role(self, thing: Object) -> Role:
        if thing.type in self._stations:
            return "station"
        if thing.type in self._players:
            return "player"
        in_containers = thing.kind in self.rendering.container.entities
        return "container" if in_containers or thing.type == "container" else "item"

    def _entity(self, kind: str) -> Entity | None:
        group = self.rendering.group_of(kind)
        return group.entities[kind] if group else None

    def _constant(self, thing: Object, name: str, default: float) -> float:
        kind, rendering = thing.kind, self.rendering
        role = self._role(thing)
        group = rendering.group_of(kind) or (
            rendering.container if role == "container" else rendering.item
        )
        entity = group.entities.get(kind)
        for constants in ([entity.constants] if entity else []) + [group.constants]:
            value: float | None = getattr(constants, name)
            if value is not None:
                # Objects at the same height would hide each other.
                return max(0.04, value) if name == "stack_offset" else value
        return default


def _inside(name: str, placed: dict[str, Placed]) -> list[Placed]:
    """Return the objects whose host is `name`, such as the water in a pot."""
    return [thing for thing in placed.values() if thing.host == name]


def _contents(name: str, placed: dict[str, Placed]) -> list[str]:
    """Return everything added to an object or to what is inside it, at any depth."""
    found: list[str] = []
    pending = [name]
    while pending:
        current = pending.pop()
        inside = [thing.thing.name for thing in _inside(current, placed)]
        more = [n for n in placed[current].contents if n in placed and n not in found]
        found += more
        pending += inside + more
    return found


def _doing(state: State) -> dict[str, dict[str, float]]:
    """Return the timed actions in progress for each object, with the share that is done."""
    doing: dict[str, dict[str, float]] = defaultdict(dict)
    for row in state.progress():
        if row.timed and row.running:
            share = row.done / max(1, row.total)
            for name in (row.subject, *row.arguments):
                doing[name][row.action] = max(share, doing[name].get(row.action, 0.0))
    return doing


def _relations(state: State) -> dict[str, list[Fact]]:
    """Return the facts that relate each object to others, with kinds in place of names."""
    kinds = {thing.name: thing.kind for thing in state.objects}
    related: dict[str, list[Fact]] = defaultdict(list)
    for atom in state.atoms():
        if len(atom) == 1:
            continue
        fact = (atom[0], *[kinds[name] for name in atom[1:]])
        for name in set(atom[1:]):
            related[name].append(fact)
    return related


def _states_of_things(domain: DomainFile) -> dict[str, str]:
    """Return words for the predicates that describe an object's state, rather than its place."""
    # Predicates that the layout implies describe places, which the picture shows anyway.
    implied = {rule.predicate for rule in domain.layout or ()}
    kinds = {f"is{kind}" for kinds in domain.kinds.values() for kind in kinds}
    nowhere = set(domain.station_types) | set(domain.player_types)
    changed: set[str] = set()
    for action in domain.action_defs:
        effects = list(action.sfx)
        changed.update(c.predicate for c in action.immediate_fx)
        while effects:
            effect = effects.pop()
            effects += effect.sfx
            if effect.type != "creation":
                changed.update(c.predicate for c in effect.fx)
    return {
        p.name: p.name.removeprefix("is").removeprefix("has").replace("_", " ")
        for p in domain.predicate_defs
        if p.name in changed - implied - kinds
        and len(p.param_types) == 1
        and p.param_types[0] not in nowhere
    }
