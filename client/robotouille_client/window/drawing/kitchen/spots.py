"""Where everything of a stage is drawn: the geometry that pictures, effects and words share."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import pygame

from robotouille.world.grounding.floor import Tile
from robotouille_client.window.drawing.kitchen.motion import Pose
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import SpritePiece, Stage

__all__ = [
    "HEAD",
    "RAISED",
    "Spot",
    "extent",
    "hands",
    "occupied",
    "pile_spot",
    "player_area",
    "size_in",
    "sizes_of_tiles",
    "spots",
    "ways",
    "workplaces",
]

RAISED = 0.12
"""How much higher than its tile a player is drawn, in tiles."""

HEAD = -0.14
"""Where a player's picture begins below the upper edge of its tile, in tiles."""

_SWIMMING = 0.36
"""How large what swims in something is drawn, of its size."""

_BODY = (0.2, HEAD, 0.6, 0.96)
_WORKTOP = (0.06, 0.14, 0.88, 0.56)
_SEEN = 0.76
"""How much of the square of a picture a thing usually fills."""

_HELD_SCALE = 0.85
"""How large what is held is drawn, of what it is elsewhere."""

_SIZES = 2
"""How often what is on its way becomes larger or smaller: each size is a picture to draw."""
_HELD = {
    "front": (0.0, 0.18),
    "right": (0.35, 0.09),
    "left": (-0.35, 0.09),
    "back": (0.0, -0.58),
}


@dataclass(frozen=True, slots=True)
class Spot:
    """The middle of a picture in pixels, and what a tile measures there."""

    x: float
    y: float
    tile: float

    def up(self, tiles: float) -> Spot:
        """The same, higher by some tiles."""
        return Spot(self.x, self.y - tiles * self.tile, self.tile)

    def towards(self, other: Spot, share: float) -> Spot:
        """A spot between two; it has one of few sizes."""
        return Spot(
            self.x + (other.x - self.x) * share,
            self.y + (other.y - self.y) * share,
            self.tile + (other.tile - self.tile) * round(share * _SIZES) / _SIZES,
        )


def sizes_of_tiles(tile: int) -> tuple[float, ...]:
    """What a tile measures where things may be: the size of most first, then of what is held, then
    of what is on its way."""
    full, held = float(tile), tile * _HELD_SCALE
    between = (held + (full - held) * n / _SIZES for n in range(1, _SIZES))
    return full, held, *between


def size_in(holder: float) -> int:
    """How large what swims in a pot or a bowl of a size is drawn, in pixels."""
    return max(1, round(_SWIMMING * holder))


def hands(layout: Layout, pose: Pose) -> Spot:
    """Where the lowest thing that a player holds is."""
    dx, dy = _HELD[pose.facing]
    x, y = layout.corner(pose.at)
    return Spot(
        x + (0.5 + dx) * layout.tile,
        y + (0.5 - RAISED + dy) * layout.tile,
        layout.tile * _HELD_SCALE,
    )


def pile_spot(layout: Layout, stage: Stage, host: str, poses: dict[str, Pose]) -> Spot | None:
    """Where the lowest thing on a station, on the floor or in somebody's hands is."""
    if host in poses:
        return hands(layout, poses[host])
    tile = stage.placed[host].tile
    if tile is None:
        return None
    x, y = layout.corner(tile)
    return Spot(
        x + layout.tile / 2, y + (0.5 - stage.bases[host]) * layout.tile, float(layout.tile)
    )


def spots(layout: Layout, stage: Stage, poses: dict[str, Pose]) -> dict[str, Spot]:
    """Where each thing is: players, stations, what lies on them and what is held or inside."""
    found = {}
    for name, pose in poses.items():
        x, y = layout.corner(pose.at)
        found[name] = Spot(
            x + layout.tile / 2, y + (0.5 - RAISED) * layout.tile, float(layout.tile)
        )
    for name in stage.stations:
        tile = stage.placed[name].tile
        if tile is not None:
            found[name] = _middle(layout, tile)
    for host, pieces in stage.piles.items():
        base = pile_spot(layout, stage, host, poses)
        if base is not None:
            found.update((piece.name, base.up(piece.rise)) for piece in pieces)
    for name, placed in stage.placed.items():
        if name not in found and placed.host in found:
            found[name] = found[placed.host]
    return found


def occupied(layout: Layout, stage: Stage, poses: dict[str, Pose]) -> list[pygame.Rect]:
    """What no words may cover: players, what they hold, stations in use with all on them."""
    areas = [player_area(layout, pose) for pose in poses.values()]
    for host, pieces in stage.piles.items():
        base = pile_spot(layout, stage, host, poses)
        if base is not None:
            areas += [_covered(piece, base) for piece in pieces]
    used = {stage.placed[name].at for name in poses} | set(stage.piles)
    for name in stage.stations:
        tile = stage.placed[name].tile
        if name in used and tile is not None:
            areas.append(_part(layout.corner(tile), _WORKTOP, layout.tile))
    return areas


def extent(layout: Layout, stage: Stage, name: str, poses: dict[str, Pose]) -> pygame.Rect | None:
    """The part of the kitchen that an object takes with all that is on it; None if nobody sees
    where it is."""
    if name in poses:
        return player_area(layout, poses[name])
    placed = stage.placed.get(name)
    if placed is None or placed.tile is None:
        return None
    base = pile_spot(layout, stage, name, poses) if name in stage.piles else None
    pieces = stage.piles[name] if base is not None else ()
    return layout.cell(placed.tile).unionall([_covered(p, base) for p in pieces if base])


def player_area(layout: Layout, pose: Pose) -> pygame.Rect:
    """The part of the kitchen that a player takes."""
    return _part(layout.corner(pose.at), _BODY, layout.tile)


def workplaces(layout: Layout, stage: Stage, plain: Collection[str]) -> list[pygame.Rect]:
    """Stations but for the plain ones: where something is done, whether it is now or not."""
    tiles = (stage.placed[name].tile for name in stage.stations if name not in plain)
    return [_part(layout.corner(tile), _WORKTOP, layout.tile) for tile in tiles if tile is not None]


def ways(
    stage: Stage,
    now: Mapping[str, Spot],
    earlier: Mapping[str, Spot],
    travels: Collection[str],
) -> list[pygame.Rect]:
    """Where things pass in a step that are on their way; that stays the same for all of it."""
    areas = []
    for pieces in stage.piles.values():
        for piece in pieces:
            if piece.name in travels and piece.name in now and piece.name in earlier:
                start = _around(piece, earlier[piece.name])
                areas.append(start.union(_around(piece, now[piece.name])))
    return areas


def _middle(layout: Layout, tile: Tile) -> Spot:
    x, y = layout.corner(tile)
    return Spot(x + layout.tile / 2, y + layout.tile * 0.4, float(layout.tile))


def _covered(piece: SpritePiece, base: Spot) -> pygame.Rect:
    return _around(piece, base.up(piece.rise))


def _around(piece: SpritePiece, spot: Spot) -> pygame.Rect:
    side = max(1, round(piece.scale * spot.tile * _SEEN))
    area = pygame.Rect(0, 0, side, side)
    area.center = (round(spot.x), round(spot.y))
    return area


def _part(
    corner: tuple[float, float], part: tuple[float, float, float, float], tile: int
) -> pygame.Rect:
    """A part of a tile, given in tiles."""
    x, y, width, height = (value * tile for value in part)
    return pygame.Rect(round(corner[0] + x), round(corner[1] + y), round(width), round(height))
