"""Draws the pictures of a task before one of them is needed, some at a time."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator

from robotouille.domain.rendering.art import SIDES, Effect
from robotouille.world.grounding.objects import Object
from robotouille.world.world import World
from robotouille_client.window.drawing.kitchen.particles import looks
from robotouille_client.window.drawing.kitchen.spots import size_in, sizes_of_tiles
from robotouille_client.window.pictures.appearance import AppearanceResolver
from robotouille_client.window.pictures.sprites import Sprites

__all__ = ["Preloader"]

Picture = tuple[str, int, int | None]
"""A file, a size and an opacity; None: as it is."""


class Preloader:
    """For one world and one size of its tiles; it stops where too many pictures are kept."""

    def __init__(
        self, world: World, resolver: AppearanceResolver, sprites: Sprites, tile: int
    ) -> None:
        self.tile = tile
        self._world = world
        self._resolver = resolver
        self._sprites = sprites
        self._left: Iterator[Picture] | None = self._pictures()

    def work(self, seconds: float) -> None:
        """Draw for so long, and to the end of the picture that is begun; one at least."""
        until = time.perf_counter() + seconds
        while self._left is not None:
            picture = next(self._left, None)
            if picture is None or not self._sprites.roomy:
                self._left = None
            else:
                self._draw(*picture)
            if time.perf_counter() >= until:
                break

    def _draw(self, file: str, size: int, opacity: int | None) -> None:
        if opacity is None:
            self._sprites.file(file, size)
        else:
            self._sprites.shade(file, size, opacity)

    def _pictures(self) -> Iterator[Picture]:
        """What is likely to be needed first is in front."""
        stations = set(self._world.task.domain.station_types)
        things = {thing.kind: thing for thing in self._world.initial.objects}.values()
        arts = [(thing, self._resolver.pictures(thing)) for thing in things]
        for file in self._of_players():
            yield file, self.tile, None
        for tile in sizes_of_tiles(self.tile):
            for thing, files in arts:
                if thing.type in stations and tile != self.tile:
                    continue
                size = max(1, round(self._resolver.scale(thing) * tile))
                yield from ((file, size, None) for file in files)
        effects = dict.fromkeys(
            e for _, files in arts for art in files.values() for e in art.effects
        )
        for effect in self._effects(effects):
            for size, opacity in looks(effect, self.tile):
                yield effect.asset, size, opacity
        for size in self._sizes_in(thing for thing, _ in arts):
            for thing, files in arts:
                if thing.type not in stations:
                    yield from ((file, size, None) for file in files)

    def _sizes_in(self, things: Iterable[Object]) -> dict[int, None]:
        """How large things are that swim in others: in what may hold others, as a pot may."""
        domain, kinds = self._world.task.domain, self._world.table.types
        rules = (rule for rule in domain.layout or () if rule.when == "shares_tile")
        holders = {kinds[rule.predicate][-1] for rule in rules}
        holders -= {*domain.station_types, *domain.player_types}
        scales = dict.fromkeys(self._resolver.scale(t) for t in things if t.type in holders)
        tiles = sizes_of_tiles(self.tile)
        return dict.fromkeys(size_in(scale * tile) for scale in scales for tile in tiles)

    def _of_players(self) -> Iterator[str]:
        for index, name in enumerate(self._world.players):
            kind = self._world.thing(name).kind
            for side in SIDES:
                for carrying in (False, True):
                    asset = self._resolver.player(kind, index, side, carrying=carrying).asset
                    if asset is not None:
                        yield asset
                yield from self._resolver.feet(kind, index, side)

    def _effects(self, names: dict[str, None]) -> Iterator[Effect]:
        """Those of pictures, and of what goes on."""
        rendering = self._resolver.rendering
        actions = (
            rendering.during[a.name] for a in self._world.schemas if a.name in rendering.during
        )
        for name in dict.fromkeys((*names, *actions, *rendering.moments.values())):
            yield rendering.effects[name]
