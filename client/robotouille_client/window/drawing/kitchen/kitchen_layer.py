"""Lowest layer: floor, wall, stations, objects and players."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, replace

import pygame

from robotouille.domain.art import SIDES, ParticleEffect
from robotouille.world.grounding.objects import Object
from robotouille.world.world import State, World
from robotouille_client.window.drawing.kitchen.animation import (
    BEATS,
    StepAnimation,
    ToolInUse,
    draw_particles,
    particle_looks,
)
from robotouille_client.window.drawing.kitchen.gestures import Gesture
from robotouille_client.window.drawing.kitchen.room import Room
from robotouille_client.window.drawing.kitchen.spots import (
    RAISED,
    Pose,
    Spot,
    size_in,
    sizes_of_tiles,
)
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import (
    Appearance,
    AppearanceResolver,
    SceneSprites,
    SpritePiece,
)
from robotouille_client.window.pictures.shapes import ellipse, seat_colour
from robotouille_client.window.pictures.sprites import Sprites

# File, size and opacity; None leaves the opacity as it is.
Picture = tuple[str, int, int | None]


class Preloader:
    """Preloads for one world and one tile size, until the picture cache is half full."""

    def __init__(
        self,
        world: World,
        resolver: AppearanceResolver,
        sprites: Sprites,
        tile: int,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.tile = tile
        self._clock = clock
        self._due = 0.0
        self._world = world
        self._resolver = resolver
        self._sprites = sprites
        self._left: Iterator[Picture] | None = self._pictures()

    def work(self, seconds: float) -> None:
        """Draw pictures for some seconds, on average.

        A picture that takes longer is finished, and the next calls draw less.
        """
        self._due = min(0.0, self._due) + seconds
        while self._left is not None and self._due > 0:
            began = self._clock()
            picture = next(self._left, None)
            if picture is None or not self._sprites.roomy:
                self._left = None
            else:
                self._draw(*picture)
            self._due -= self._clock() - began

    def _draw(self, file: str, size: int, opacity: int | None) -> None:
        if opacity is None:
            self._sprites.file(file, size)
        else:
            self._sprites.shade(file, size, opacity)

    def _pictures(self) -> Iterator[Picture]:
        """Yield pictures, those likely to be needed first at the front."""
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
            for size, opacity in particle_looks(effect, self.tile):
                yield effect.asset, size, opacity
        for size in self._sizes_in(thing for thing, _ in arts):
            for thing, files in arts:
                if thing.type not in stations:
                    yield from ((file, size, None) for file in files)

    def _sizes_in(self, things: Iterable[Object]) -> dict[int, None]:
        """Return the sizes of objects that swim in others, such as in a pot."""
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
                if shut := self._resolver.shut_eyes(kind, index, side):
                    yield shut
            if cheering := self._resolver.cheering(kind, index).asset:
                yield cheering

    def _effects(self, names: dict[str, None]) -> Iterator[ParticleEffect]:
        """Yield the effects of pictures, actions and the end of the game."""
        rendering = self._resolver.rendering
        actions = (
            rendering.during[a.name] for a in self._world.schemas if a.name in rendering.during
        )
        for name in dict.fromkeys((*names, *actions, *rendering.moments.values())):
            yield rendering.effects[name]


# Height of a tool over an object, and the length of its stroke, in tiles.
_TOOL, _STROKE = 0.18, 0.16

# Movements of an object that cooks, in a step, and how far it moves, in tiles.
_SHAKES, _SHAKEN = 1.5, 0.012

# Height of the arc of a taken object, in tiles.
_ARC = 0.24

# Visible share of an object that swims in another.
_ABOVE = 0.7

# Height of the surface above the middle of a container, and its width, as shares of its size.
_SURFACE, _OPENING = 0.06, 0.5


@dataclass(frozen=True, slots=True)
class SceneFrame:
    """Everything to draw at one moment between two states.

    Attributes:
        spots: Places of players, stations and objects.
        earlier: Their places before the step.
        gestures: How each player holds itself.
        phase: Share of the step that has passed.
        time: Time in steps.
        lively: True if more moves than objects and players on their way.
    """

    stage: SceneSprites
    poses: dict[str, Pose]
    spots: dict[str, Spot]
    earlier: dict[str, Spot]
    animation: StepAnimation
    gestures: dict[str, Gesture]
    phase: float = 1.0
    time: float = 0.0
    lively: bool = True


class KitchenLayer:
    """Draws the kitchen of one world. What never moves is drawn once for each size."""

    def __init__(self, world: World, resolver: AppearanceResolver, sprites: Sprites) -> None:
        self._world = world
        ground = world.task.problem.ground or ()
        self._room = Room(resolver.rendering.floor, ground, sprites)
        self._sprites = sprites
        self._resolver = resolver
        self._background: pygame.Surface | None = None
        self._floor_of: tuple[Layout, int] | None = None
        self._stations: dict[str, Appearance] = {}

    def stage(self, state: State) -> SceneSprites:
        """Return everything to draw of a state."""
        return self._resolver.stage(state)

    def background(self, layout: Layout, stage: SceneSprites) -> pygame.Surface:
        """Return everything behind what moves."""
        floor_of = (layout, self._sprites.revision)
        if self._background is None or self._floor_of != floor_of:
            self._background = self._room.draw(layout)
            self._floor_of, self._stations = floor_of, {}
        # Stations are part of the background; only those with a new look are drawn again.
        changed = [n for n, a in stage.stations.items() if self._stations.get(n) != a]
        for name in changed:
            tile = stage.placed[name].tile
            if tile is not None:
                self._room.tile(self._background, layout, tile)
                picture = self._sprites.of(stage.stations[name], layout.tile)
                self._background.blit(picture, layout.cell(tile))
        self._stations = stage.stations
        return self._background

    def draw(
        self, target: pygame.Surface, layout: Layout, frame: SceneFrame, own: Collection[str | None]
    ) -> None:
        """Draw everything that moves, row by row from the top, then objects on their way.

        Args:
            own: Players of the people at the window, who stand in a patch of light.
        """
        stage, poses = frame.stage, frame.poses
        # Rows nearer to the viewer cover those behind; in a row, players cover objects.
        rows: list[tuple[float, int, str]] = [(-pose.at[1], 1, n) for n, pose in poses.items()]
        for host in stage.piles:
            tile = stage.placed[host].tile
            if host not in poses and tile is not None:
                rows.append((-tile[1], 0, host))
        for _, is_player, name in sorted(rows):
            if is_player:
                self._player(target, layout, frame, name, own=name in own)
            else:
                self._pile(target, frame, name)
        self._travels(target, frame)
        for work in frame.animation.tools:
            self._tool(target, frame, work)
        for emission in frame.animation.emissions:
            spot = frame.spots.get(emission.source)
            if spot is not None and frame.lively:
                draw_particles(target, self._sprites, emission, spot, frame.time)

    def _travels(self, target: pygame.Surface, frame: SceneFrame) -> None:
        """Draw objects on their way between two places, in a low arc."""
        share = _eased(frame.phase)
        for pieces in frame.stage.piles.values():
            for piece in pieces:
                if piece.name in frame.animation.travels and piece.name in frame.spots:
                    end = frame.spots[piece.name]
                    start = frame.earlier.get(piece.name, end)
                    arc = _ARC * math.sin(math.pi * share)
                    self._piece(target, piece, start.towards(end, share).up(arc))

    def _tool(self, target: pygame.Surface, frame: SceneFrame, work: ToolInUse) -> None:
        """Draw a tool over the object that it works on."""
        spot = frame.spots.get(work.target)
        if spot is None:
            return
        tool, size = work.tool, round(work.tool.size * spot.tile)
        wave = math.sin(math.tau * BEATS * frame.time) if frame.lively else 0.0
        lift, side = _TOOL + _STROKE * abs(wave), 0.0
        if tool.motion == "scrub":
            lift, side = _TOOL, _STROKE * wave
        at = Spot(spot.x + (_TOOL / 2 + side) * spot.tile, spot.y - lift * spot.tile, spot.tile)
        self._picture(target, tool.asset, at, size)

    def _pile(
        self, target: pygame.Surface, frame: SceneFrame, host: str, lift: float = 0.0
    ) -> None:
        """Draw the objects on a station or in a player's hands, some tiles higher."""
        pieces = frame.stage.piles.get(host, ())
        for piece in pieces:
            spot = frame.spots.get(piece.name)
            if spot is None or piece.name in frame.animation.travels:
                continue
            if frame.lively and piece.name in frame.animation.shaken:
                aside = _SHAKEN * spot.tile * math.sin(math.tau * _SHAKES * frame.time)
                spot = replace(spot, x=spot.x + aside)
            self._piece(target, piece, spot.up(lift), whole=piece is pieces[-1])

    def _piece(
        self, target: pygame.Surface, piece: SpritePiece, spot: Spot, *, whole: bool = True
    ) -> None:
        """Draw one object, and its contents if nothing lies on top."""
        self._centred(target, piece.appearance, spot.x, spot.y, piece.scale * spot.tile)
        if whole and piece.contents:
            self._contents(target, piece, spot.x, spot.y, spot.tile)

    def _contents(
        self, target: pygame.Surface, piece: SpritePiece, x: float, y: float, tile: float
    ) -> None:
        """Draw small pictures that swim in a pot, with their lower part under the surface."""
        appearances = piece.contents[:4]
        whole = piece.scale * tile
        side, gap = size_in(whole), _OPENING * whole / len(appearances)
        left, seen = x - gap * (len(appearances) - 1) / 2, round(side * _ABOVE)
        top = round(y - _SURFACE * whole) - seen
        for i, appearance in enumerate(appearances):
            corner = (round(left + i * gap - side / 2), top)
            target.blit(self._sprites.of(appearance, side), corner, (0, 0, side, seen))

    def _centred(
        self, target: pygame.Surface, appearance: Appearance, x: float, y: float, side: float
    ) -> None:
        size = max(1, round(side))
        target.blit(self._sprites.of(appearance, size), (round(x - size / 2), round(y - size / 2)))

    def _player(
        self, target: pygame.Surface, layout: Layout, frame: SceneFrame, name: str, *, own: bool
    ) -> None:
        size, spot = layout.tile, frame.spots[name]
        index = self._world.players.index(name)
        if own:
            self._light(target, spot, index)
        kind, gesture = self._world.thing(name).kind, frame.gestures[name]
        body = Spot(spot.x + gesture.lean * size, spot.y - gesture.lift * size, spot.tile)
        feet = self._resolver.feet(kind, index, gesture.facing)
        if feet:
            self._picture(target, feet[gesture.stride % len(feet)], spot, size)
        if gesture.arms == "up":
            appearance = self._resolver.cheering(kind, index)
        else:
            carrying = gesture.arms == "out"
            appearance = self._resolver.player(kind, index, gesture.facing, carrying=carrying)
        picture = self._sprites.squashed(appearance, size, gesture.squash)
        foot = round(body.y + size / 2)
        target.blit(picture, picture.get_rect(midbottom=(round(body.x), foot)))
        if gesture.shut and not gesture.squash:
            self._picture(target, self._resolver.shut_eyes(kind, index, gesture.facing), body, size)
        self._pile(target, frame, name, gesture.lift)

    def _picture(self, target: pygame.Surface, name: str | None, spot: Spot, size: int) -> None:
        picture = self._sprites.file(name, size)
        if picture is not None:
            target.blit(picture, (round(spot.x - size / 2), round(spot.y - size / 2)))

    def _light(self, target: pygame.Surface, spot: Spot, index: int) -> None:
        """Draw a patch of light under the local player."""
        area = pygame.Rect(0, 0, round(spot.tile * 0.8), round(spot.tile * 0.28))
        area.center = (round(spot.x), round(spot.y + (0.31 + RAISED) * spot.tile))
        target.blit(ellipse(area.size, (*seat_colour(index), 130)), area)


def _eased(share: float) -> float:
    """Return a share of a way, slow at both ends."""
    return share * share * (3 - 2 * share)
