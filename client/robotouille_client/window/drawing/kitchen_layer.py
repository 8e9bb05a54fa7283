"""The kitchen itself: floor, wall, stations, what lies on them, and the players."""

from __future__ import annotations

import math

import pygame

from robotouille.world.grounding.floor import Tile
from robotouille.world.world import State, World
from robotouille_client.window.drawing.motion import Pose
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

__all__ = ["HEAD", "RAISED", "KitchenLayer"]

RAISED = 0.12
"""How much higher than its tile a player is drawn, in tiles."""

HEAD = -0.14
"""Where a player's picture begins below the upper edge of its tile, in tiles."""

_BODY = (0.2, HEAD, 0.6, 0.96)
_WORKTOP = (0.06, 0.14, 0.88, 0.56)
_SEEN = 0.76
"""How much of the square of a picture a thing usually fills."""

_HELD_SCALE = 0.85
_STRIDES = 4
"""How many steps a player takes on each tile."""

_HELD = {
    "front": (0.0, 0.18),
    "right": (0.35, 0.09),
    "left": (-0.35, 0.09),
    "back": (0.0, -0.58),
}
_MINI = 0.3


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
        stage: Stage,
        poses: dict[str, Pose],
        me: str | None,
    ) -> None:
        """Everything that moves, row by row from the top."""
        players = self._world.players
        rows: list[tuple[float, int, str]] = [(-pose.at[1], 1, n) for n, pose in poses.items()]
        for host in stage.piles:
            tile = stage.placed[host].tile
            if host not in players and tile is not None:
                rows.append((-tile[1], 0, host))
        for _, is_player, name in sorted(rows):
            if is_player:
                self._player(target, layout, stage, name, poses[name], own=name == me)
            else:
                self._pile_on_tile(target, layout, stage, name)

    def occupied(self, layout: Layout, stage: Stage, poses: dict[str, Pose]) -> list[pygame.Rect]:
        """What no words may cover: players, what they hold, stations in use with all on them."""
        areas = []
        for name, pose in poses.items():
            corner = layout.corner(pose.at)
            areas.append(_part(corner, _BODY, layout.tile))
            areas += self._covered(stage.piles.get(name, ()), *self._hands(corner, pose, layout))
        for host, pieces in stage.piles.items():
            tile = stage.placed[host].tile
            if host not in poses and tile is not None:
                middle = self._top_of(layout, stage, host, tile)
                areas += self._covered(pieces, middle, layout.tile)
        busy = {stage.placed[name].at for name in poses} | set(stage.piles)
        for name in stage.stations:
            tile = stage.placed[name].tile
            if name in busy and tile is not None:
                areas.append(_part(layout.corner(tile), _WORKTOP, layout.tile))
        return areas

    def _covered(
        self, pieces: tuple[SpritePiece, ...], middle: tuple[float, float], tile: float
    ) -> list[pygame.Rect]:
        areas = []
        for piece in pieces:
            side = max(1, round(piece.scale * tile * _SEEN))
            area = pygame.Rect(0, 0, side, side)
            area.center = (round(middle[0]), round(middle[1] - piece.rise * tile))
            areas.append(area)
        return areas

    def _empty(self, layout: Layout) -> pygame.Surface:
        """The window with its wall and floor."""
        surface = pygame.Surface(layout.size)
        surface.fill(BACKGROUND)
        frame = layout.kitchen.inflate(12, 12)
        surface.blit(box(frame.size, INK, 10), frame)
        wall = self._sprites.file(self._rendering.floor.wall, layout.tile)
        for x in range(layout.columns):
            corner = layout.cell((x, layout.rows))
            if wall is None:
                surface.fill((196, 214, 202), corner)
            else:
                surface.blit(wall, corner)
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

    def _pile_on_tile(
        self, target: pygame.Surface, layout: Layout, stage: Stage, host: str
    ) -> None:
        tile = stage.placed[host].tile
        assert tile is not None  # noqa: S101
        middle = self._top_of(layout, stage, host, tile)
        self._pile(target, stage.piles[host], middle, layout.tile)

    def _top_of(self, layout: Layout, stage: Stage, host: str, tile: Tile) -> tuple[float, float]:
        """Where the lowest thing on a station has its middle."""
        x, y = layout.corner(tile)
        return x + layout.tile / 2, y + (0.5 - stage.bases[host]) * layout.tile

    def _hands(
        self, corner: tuple[float, float], pose: Pose, layout: Layout
    ) -> tuple[tuple[float, float], float]:
        """Where what a player holds has its middle, and how large a tile is there."""
        dx, dy = _HELD[pose.facing]
        x, y = corner[0] + layout.tile / 2, corner[1] + (0.5 - RAISED) * layout.tile
        return (x + dx * layout.tile, y + dy * layout.tile), layout.tile * _HELD_SCALE

    def _pile(
        self,
        target: pygame.Surface,
        pieces: tuple[SpritePiece, ...],
        middle: tuple[float, float],
        tile: float,
    ) -> None:
        x, y = middle
        for piece in pieces:
            self._centred(target, piece.appearance, x, y - piece.rise * tile, piece.scale * tile)
        top = pieces[-1]
        if top.contents:
            self._contents(target, top, x, y - top.rise * tile, tile)

    def _contents(
        self, target: pygame.Surface, piece: SpritePiece, x: float, y: float, tile: float
    ) -> None:
        """Small pictures of what is in a pot, along its lower edge."""
        appearances = piece.contents[:4]
        gap = min(_MINI * 0.8, piece.scale / len(appearances)) * tile
        start = x - gap * (len(appearances) - 1) / 2
        for i, appearance in enumerate(appearances):
            self._centred(
                target, appearance, start + i * gap, y + 0.3 * piece.scale * tile, _MINI * tile
            )

    def _centred(
        self, target: pygame.Surface, appearance: Appearance, x: float, y: float, side: float
    ) -> None:
        size = max(1, round(side))
        target.blit(self._sprites.of(appearance, size), (round(x - size / 2), round(y - size / 2)))

    def _player(
        self,
        target: pygame.Surface,
        layout: Layout,
        stage: Stage,
        name: str,
        pose: Pose,
        *,
        own: bool,
    ) -> None:
        size = layout.tile
        index = self._world.players.index(name)
        x, y = layout.corner(pose.at)
        if own:
            self._spot(target, x, y, size, index)
        kind, held = self._world.thing(name).kind, stage.piles.get(name, ())
        hop = 0.03 * abs(math.sin(math.pi * _STRIDES / 2 * pose.stride)) if pose.walking else 0.0
        middle = (x + size / 2, y + (0.5 - RAISED) * size)
        feet = self._resolver.feet(kind, index, pose.facing)
        if feet:
            frame = int(pose.stride * _STRIDES) % len(feet) if pose.walking else 0
            self._picture(target, feet[frame], middle, size)
        appearance = self._resolver.player(kind, index, pose.facing, carrying=bool(held))
        self._centred(target, appearance, middle[0], middle[1] - hop * size, size)
        if held:
            self._pile(target, held, *self._hands(layout.corner(pose.at), pose, layout))

    def _picture(
        self, target: pygame.Surface, name: str, middle: tuple[float, float], size: int
    ) -> None:
        picture = self._sprites.file(name, size)
        if picture is not None:
            corner = (round(middle[0] - size / 2), round(middle[1] - size / 2))
            target.blit(picture, corner)

    def _spot(self, target: pygame.Surface, x: float, y: float, size: int, index: int) -> None:
        """A patch of light under the player of the window's owner."""
        area = pygame.Rect(0, 0, round(size * 0.8), round(size * 0.28))
        area.center = (round(x + size / 2), round(y + size * 0.81))
        colour = seat_colour(index)
        target.blit(ellipse(area.size, (*colour, 130)), area)


def _part(
    corner: tuple[float, float], part: tuple[float, float, float, float], tile: int
) -> pygame.Rect:
    """A part of a tile, given in tiles."""
    x, y, width, height = (value * tile for value in part)
    return pygame.Rect(round(corner[0] + x), round(corner[1] + y), round(width), round(height))
