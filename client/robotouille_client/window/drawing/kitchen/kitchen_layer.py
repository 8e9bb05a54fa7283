"""The kitchen itself: floor, wall, stations, what lies on them, and the players."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pygame

from robotouille.world.grounding.floor import Tile
from robotouille.world.world import State, World
from robotouille_client.window.drawing.kitchen.life import Life
from robotouille_client.window.drawing.kitchen.motion import Pose
from robotouille_client.window.drawing.kitchen.particles import draw_particles
from robotouille_client.window.drawing.kitchen.spots import RAISED, Spot, size_in
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import (
    Appearance,
    AppearanceResolver,
    SpritePiece,
    Stage,
)
from robotouille_client.window.pictures.badges import seat_colour
from robotouille_client.window.pictures.shapes import box, ellipse
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.theme import BACKGROUND, INK

__all__ = ["Frame", "KitchenLayer"]

_STRIDES = 4
"""How many steps a player takes on each tile."""

_BEATS = 2
"""How often somebody who works stretches their arms in a step."""

_HOP, _ARC = 0.03, 0.18
"""How high a walker hops, and what is taken or put is lifted, in tiles."""

_ABOVE = 0.7
"""How much is seen of what swims in something."""

_SURFACE, _OPENING = 0.06, 0.5
"""How high the surface is above the middle of what holds it, and how wide, of its size."""


@dataclass(frozen=True, slots=True)
class Frame:
    """Everything to draw at one moment between two states, `phase` of the way.

    `spots` are where things are, `earlier` where they were before the step. `time` is in steps.
    One that is not `lively` has no movement but that from place to place.
    """

    stage: Stage
    poses: dict[str, Pose]
    spots: dict[str, Spot]
    earlier: dict[str, Spot]
    life: Life
    phase: float = 1.0
    time: float = 0.0
    lively: bool = True


class KitchenLayer:
    """Draws one world's stages; what never moves is drawn once for each size."""

    def __init__(self, world: World, resolver: AppearanceResolver, sprites: Sprites) -> None:
        self._world = world
        self._rendering = resolver.rendering
        self._sprites = sprites
        self._resolver = resolver
        self._background: pygame.Surface | None = None
        self._floor_of: Layout | None = None
        self._stations: dict[str, Appearance] = {}

    def stage(self, state: State) -> Stage:
        """What to draw of a state."""
        return self._resolver.stage(state)

    def background(self, layout: Layout, stage: Stage) -> pygame.Surface:
        """Everything behind what moves."""
        if self._background is None or self._floor_of != layout:
            self._background = self._empty(layout)
            self._floor_of, self._stations = layout, {}
        changed = [n for n, a in stage.stations.items() if self._stations.get(n) != a]
        for name in changed:
            tile = stage.placed[name].tile
            if tile is not None:
                self._tile(self._background, layout, tile)
                picture = self._sprites.of(stage.stations[name], layout.tile)
                self._background.blit(picture, layout.cell(tile))
        self._stations = stage.stations
        return self._background

    def draw(
        self,
        target: pygame.Surface,
        layout: Layout,
        frame: Frame,
        me: str | None,
    ) -> None:
        """Everything that moves, row by row from the top; over it what is between two places."""
        stage, poses = frame.stage, frame.poses
        rows: list[tuple[float, int, str]] = [(-pose.at[1], 1, n) for n, pose in poses.items()]
        for host in stage.piles:
            tile = stage.placed[host].tile
            if host not in poses and tile is not None:
                rows.append((-tile[1], 0, host))
        for _, is_player, name in sorted(rows):
            if is_player:
                self._player(target, layout, frame, name, own=name == me)
            else:
                self._pile(target, layout, frame, name)
        self._travels(target, layout, frame)
        for emission in frame.life.emissions:
            spot = frame.spots.get(emission.source)
            if spot is not None and frame.lively:
                draw_particles(target, self._sprites, emission, spot, frame.time)

    def _travels(self, target: pygame.Surface, layout: Layout, frame: Frame) -> None:
        """What somebody takes or puts is on its way for a step, in a low arc."""
        share = _eased(frame.phase)
        for pieces in frame.stage.piles.values():
            for piece in pieces:
                if piece.name in frame.life.travels and piece.name in frame.spots:
                    end = frame.spots[piece.name]
                    start = frame.earlier.get(piece.name, end)
                    arc = _ARC * math.sin(math.pi * share)
                    self._piece(target, piece, start.towards(end, share).up(arc))

    def _empty(self, layout: Layout) -> pygame.Surface:
        """The window with its wall and floor."""
        surface = pygame.Surface(layout.size)
        surface.fill(BACKGROUND)
        frame = layout.kitchen.inflate(12, 12)
        surface.blit(box(frame.size, INK, 10), frame)
        wall = self._sprites.file(self._rendering.floor.wall, layout.tile)
        for x in range(layout.columns):
            foot = layout.cell((x, layout.rows - 1)).top
            area = pygame.Rect(
                layout.cell((x, 0)).left, foot - layout.wall, layout.tile, layout.wall
            )
            if wall is None:
                surface.fill((196, 214, 202), area)
            else:
                surface.blit(wall, area, (0, layout.tile - layout.wall, *area.size))
            for y in range(layout.rows):
                self._tile(surface, layout, (x, y))
        return surface

    def _tile(self, surface: pygame.Surface, layout: Layout, tile: Tile) -> None:
        """One tile of the floor."""
        art, ground = self._rendering.floor, self._world.task.problem.ground or ()
        x, row = tile[0], layout.rows - 1 - tile[1]
        letter = ground[row][x : x + 1] if row < len(ground) else ""
        picture = self._sprites.file(art.tiles.get(letter, art.default), layout.tile)
        if picture is None:
            colour = (236, 226, 206) if (x + row) % 2 else (226, 214, 192)
            surface.fill(colour, layout.cell(tile))
        else:
            surface.blit(picture, layout.cell(tile))

    def _pile(self, target: pygame.Surface, layout: Layout, frame: Frame, host: str) -> None:
        pieces = frame.stage.piles.get(host, ())
        for piece in pieces:
            spot = frame.spots.get(piece.name)
            if spot is not None and piece.name not in frame.life.travels:
                self._piece(target, piece, spot, whole=piece is pieces[-1])

    def _piece(
        self, target: pygame.Surface, piece: SpritePiece, spot: Spot, *, whole: bool = True
    ) -> None:
        """One thing, with what is in it if it is the uppermost."""
        self._centred(target, piece.appearance, spot.x, spot.y, piece.scale * spot.tile)
        if whole and piece.contents:
            self._contents(target, piece, spot.x, spot.y, spot.tile)

    def _contents(
        self, target: pygame.Surface, piece: SpritePiece, x: float, y: float, tile: float
    ) -> None:
        """Small pictures of what is in a pot: they swim in it, with their lower part under."""
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
        self, target: pygame.Surface, layout: Layout, frame: Frame, name: str, *, own: bool
    ) -> None:
        size, pose, spot = layout.tile, frame.poses[name], frame.spots[name]
        index = self._world.players.index(name)
        if own:
            self._light(target, spot, index)
        kind, held = self._world.thing(name).kind, bool(frame.stage.piles.get(name))
        feet, stride = self._resolver.feet(kind, index, pose.facing), 0
        hop = reach = 0.0
        if frame.lively and pose.walking:
            stride = int(pose.stride * _STRIDES)
            hop = _HOP * abs(math.sin(math.pi * _STRIDES / 2 * pose.stride))
        elif frame.lively and name in frame.life.working:
            reach = math.sin(math.tau * _BEATS * frame.phase)
            hop = _HOP * abs(reach)
        if feet:
            self._picture(target, feet[stride % len(feet)], spot, size)
        arms = held or reach > 0 or (name in frame.life.working and not frame.lively)
        appearance = self._resolver.player(kind, index, pose.facing, carrying=arms)
        self._centred(target, appearance, spot.x, spot.y - hop * size, size)
        self._pile(target, layout, frame, name)

    def _picture(self, target: pygame.Surface, name: str, spot: Spot, size: int) -> None:
        picture = self._sprites.file(name, size)
        if picture is not None:
            target.blit(picture, (round(spot.x - size / 2), round(spot.y - size / 2)))

    def _light(self, target: pygame.Surface, spot: Spot, index: int) -> None:
        """A patch of light under the player of the window's owner."""
        area = pygame.Rect(0, 0, round(spot.tile * 0.8), round(spot.tile * 0.28))
        area.center = (round(spot.x), round(spot.y + (0.31 + RAISED) * spot.tile))
        target.blit(ellipse(area.size, (*seat_colour(index), 130)), area)


def _eased(share: float) -> float:
    """A share of a way, slow at both ends."""
    return share * share * (3 - 2 * share)
