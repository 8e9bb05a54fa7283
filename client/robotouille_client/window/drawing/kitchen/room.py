"""The room around the kitchen: wall, floor, and what hangs or stands there."""

from __future__ import annotations

from collections.abc import Sequence

import pygame

from robotouille.domain.art import FileName
from robotouille.domain.rendering import FloorArt
from robotouille.world.grounding.objects import Tile
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.theme import BACKGROUND, INK

# Edge of the kitchen in pixels.
_EDGE = 6
# Opacity of the shade over the room, where nobody can walk.
_SHADE = 140
# Share of the wall that is above its skirting, and of that what a picture takes.
_WALL_FREE, _PICTURE = 0.8, 0.94
# Tiles between two pictures on the wall, and the size in tiles of what stands in the room.
_APART, _STANDING = 2.5, 0.9


class Room:
    """Room of one kitchen, with floor tiles by their letter in the problem's `ground`."""

    def __init__(self, art: FloorArt, ground: Sequence[str], sprites: Sprites) -> None:
        self._art = art
        self._ground = ground
        self._sprites = sprites

    def draw(self, layout: Layout) -> pygame.Surface:
        """Return a picture of the whole window, without stations."""
        surface = pygame.Surface(layout.size)
        surface.fill(BACKGROUND)
        kitchen = layout.kitchen.inflate(2 * _EDGE, 2 * _EDGE)
        around = pygame.Rect(0, 0, layout.panel.left, kitchen.bottom)
        surface.set_clip(around)
        left = -(-layout.left // layout.tile)
        columns = range(-left, -(-(around.right - layout.left) // layout.tile))
        self._wall(surface, layout, columns)
        for x in columns:
            for y in range(-1, layout.rows):
                self.tile(surface, layout, (x, y))
        self._hang(surface, layout, columns)
        self._stand(surface, layout, left)
        shade = pygame.Surface(around.size, pygame.SRCALPHA)
        shade.fill((*BACKGROUND, _SHADE))
        inside = surface.subsurface(layout.kitchen.clip(surface.get_rect())).copy()
        surface.blit(shade, around)
        surface.blit(box(kitchen.size, INK, 10), kitchen)
        surface.blit(inside, layout.kitchen)
        surface.set_clip(None)
        return surface

    def tile(self, surface: pygame.Surface, layout: Layout, tile: Tile) -> None:
        """Draw one tile of the floor."""
        x, row = tile[0], layout.rows - 1 - tile[1]
        known = 0 <= row < len(self._ground) and 0 <= x < len(self._ground[row])
        letter = self._ground[row][x] if known else ""
        picture = self._sprites.file(self._art.tiles.get(letter, self._art.default), layout.tile)
        if picture is None:
            colour = (236, 226, 206) if (x + row) % 2 else (226, 214, 192)
            surface.fill(colour, layout.cell(tile))
        else:
            surface.blit(picture, layout.cell(tile))

    def _wall(self, surface: pygame.Surface, layout: Layout, columns: range) -> None:
        picture, tile = self._sprites.file(self._art.wall, layout.tile), layout.tile
        foot = layout.kitchen.top + layout.wall
        for x in columns:
            left = layout.left + x * tile
            if picture is None:
                surface.fill((196, 214, 202), (left, 0, tile, foot))
                continue
            surface.blit(picture, (left, foot - tile))
            # Above its picture, the wall goes on without a skirting.
            free = max(1, round(tile * _WALL_FREE))
            for bottom in range(foot - tile, 0, -free):
                surface.blit(picture, (left, bottom - free), (0, 0, tile, free))

    def _hang(self, surface: pygame.Surface, layout: Layout, columns: range) -> None:
        """Hang pictures on the wall, evenly from the middle of the kitchen to both sides."""
        pictures, step = self._art.on_wall, round(_APART * layout.tile)
        side = round(layout.wall * _WALL_FREE * _PICTURE)
        if not pictures or side < 1:
            return
        kitchen = layout.kitchen.inflate(2 * _EDGE, 0)
        middle = kitchen.top + round(layout.wall * _WALL_FREE / 2)
        most = len(columns) * layout.tile // step + 1
        for number in range(-most, most + 1):
            picture = self._sprites.file(pictures[number % len(pictures)], side)
            place = pygame.Rect(0, 0, side, side)
            place.center = layout.kitchen.centerx + number * step, middle
            on_edge = any(place.left < x < place.right for x in (kitchen.left, kitchen.right))
            if picture is not None and not on_edge:
                surface.blit(picture, place)

    def _stand(self, surface: pygame.Surface, layout: Layout, margin: int) -> None:
        """Put things on the floor of the margins, where they are wide enough."""
        things: tuple[FileName, ...] = self._art.beside
        side = round(_STANDING * layout.tile)
        if not things or layout.left < side + _EDGE:
            return
        for row in range(0, layout.rows, 3):
            for edge, number in ((-1, row // 3), (layout.columns, row // 3 + 1)):
                picture = self._sprites.file(things[number % len(things)], side)
                if picture is not None:
                    surface.blit(picture, picture.get_rect(center=layout.cell((edge, row)).center))
