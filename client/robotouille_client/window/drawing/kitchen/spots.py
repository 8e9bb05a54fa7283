"""Geometry of a drawn state: where players, pictures, effects and labels go."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import pygame

from robotouille.world.grounding.objects import Floor, Tile
from robotouille.world.scene import Placed
from robotouille.world.world import State
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import SceneSprites, SpritePiece

Point = tuple[float, float]

# Tiles between players that share a tile.
_SIDE_BY_SIDE = 0.5

# Distance in tiles at which walkers begin to step aside, and how far they do so.
_CLOSE, _ASIDE = 1.0, 0.3


@dataclass(frozen=True, slots=True)
class Pose:
    """Position and direction of a player; `stride` runs from 0 to 1 on each tile."""

    at: Point
    facing: str
    walking: bool = False
    stride: float = 0.0


@dataclass(frozen=True, slots=True)
class _Walk:
    path: tuple[Tile, ...]
    began: int
    steps: int

    def share(self, step: int, phase: float) -> float:
        return min(1.0, max(0.0, (step - self.began + phase) / self.steps))


def along(path: tuple[Tile, ...], share: float) -> tuple[Point, Tile, float]:
    """Return the point at a share of a path, the direction there and the share of its tile."""
    legs = len(path) - 1
    if legs < 1:
        return path[0], (0, 0), 0.0
    leg = min(legs - 1, int(share * legs))
    rest = share * legs - leg
    (x, y), (to_x, to_y) = path[leg], path[leg + 1]
    return (x + (to_x - x) * rest, y + (to_y - y) * rest), (to_x - x, to_y - y), rest


def looking(direction: tuple[int, int]) -> str:
    """Return which side of a player is seen when it looks along a vector."""
    dx, dy = direction
    if abs(dx) > abs(dy):
        return "right" if dx > 0 else "left"
    return "back" if dy > 0 else "front"


class Motion:
    """Tracks the walks in progress.

    A walk of several steps starts where the player was last drawn, and ends when the player is no
    longer busy. If steps are skipped, players appear at their new places.
    """

    def __init__(self, floor: Floor) -> None:
        self._floor = floor
        self._step = -1
        self._state: State | None = None
        self._walks: dict[str, _Walk] = {}

    def poses(
        self,
        state: State,
        now: dict[str, Placed],
        before: dict[str, Placed] | None,
        step: int,
        phase: float,
    ) -> dict[str, Pose]:
        """Return the pose of each player, `phase` of the way from the previous state to `state`."""
        if state is not self._state or step != self._step:
            self._advance(state, now, before or now, step)
        poses = {}
        for name in state.world.players:
            placed = now.get(name)
            if placed is not None and placed.tile is not None:
                poses[name] = self._pose(placed, self._walks.get(name), step, phase)
        return _apart(poses)

    def walking(self, step: int) -> bool:
        """Return whether any player walks during a step, the last one that poses were asked for."""
        return any(walk.share(step, 0.0) < 1.0 for walk in self._walks.values())

    def _advance(
        self, state: State, now: dict[str, Placed], before: dict[str, Placed], step: int
    ) -> None:
        # After a jump to another step, walks in progress mean nothing.
        follows = self._state is None or step in (self._step, self._step + 1)
        kept = self._walks if follows else {}
        self._walks = {}
        for name in state.world.players:
            walk = kept.get(name)
            here, there = before.get(name), now.get(name)
            if here is None or there is None or here.tile is None or there.tile is None:
                continue
            busy = state.busy_steps(name)
            if walk is not None and walk.share(step, 0.0) >= 1.0:
                walk = None
            if walk is not None and walk.path[-1] == there.tile:
                self._walks[name] = walk
            elif here.tile != there.tile:
                # A new walk may begin before the old one has ended.
                start = self._midway(walk, step) if walk else here.tile
                path = tuple(self._floor.path(start, there.tile))
                self._walks[name] = _Walk(path, step, busy + 1)
        self._state, self._step = state, step

    def _midway(self, walk: _Walk, step: int) -> Tile:
        (x, y), _, _ = along(walk.path, walk.share(step, 0.0))
        return round(x), round(y)

    def _pose(self, placed: Placed, walk: _Walk | None, step: int, phase: float) -> Pose:
        assert placed.tile is not None  # noqa: S101
        share = walk.share(step, phase) if walk else 1.0
        if walk is None or share >= 1.0:
            return Pose(placed.tile, looking(placed.facing or (0, -1)))
        at, direction, stride = along(walk.path, share)
        return Pose(at, looking(direction), True, stride)


def _apart(poses: dict[str, Pose]) -> dict[str, Pose]:
    """Place players that share a tile side by side, and let walkers pass each other.

    The world lets players walk through each other. On the screen, each of two that come close steps
    aside: more, the closer they are, and across the walk.
    """
    found = dict(poses)
    sharing: dict[Point, list[str]] = {}
    for name, pose in poses.items():
        sharing.setdefault(pose.at, []).append(name)
    for (x, y), names in sharing.items():
        if len(names) > 1:
            gap = _SIDE_BY_SIDE / (len(names) - 1)
            for i, name in enumerate(names):
                at = (x - _SIDE_BY_SIDE / 2 + i * gap, y)
                found[name] = replace(poses[name], at=at)
    for one, other in combinations(poses, 2):
        if poses[one].at != poses[other].at:
            _pass(found, poses, one, other)
    return found


def _pass(found: dict[str, Pose], poses: dict[str, Pose], one: str, other: str) -> None:
    """Move two players apart if at least one of them walks close to the other."""
    first, second = poses[one], poses[other]
    if not (first.walking or second.walking):
        return
    dx, dy = second.at[0] - first.at[0], second.at[1] - first.at[1]
    aside = _ASIDE * max(0.0, 1.0 - math.hypot(dx, dy) / _CLOSE)
    walker = first if first.walking else second
    across = walker.facing in ("left", "right")
    for name, side in ((one, -aside), (other, aside)):
        x, y = found[name].at
        at = (x, y - side) if across else (x + side, y)
        found[name] = replace(found[name], at=at)


# Tiles by which a player is drawn above its tile.
RAISED = 0.12

# Top of a player's picture below the top of its tile, in tiles.
HEAD = -0.14

# Size of an object that swims in another, as a share of its container's.
_SWIMMING = 0.36

_BODY = (0.2, HEAD, 0.6, 0.96)
_WORKTOP = (0.06, 0.14, 0.88, 0.56)
# Share of a picture's square that an object usually fills.
_SEEN = 0.76

# Size of a held object, as a share of its usual size.
_HELD_SCALE = 0.85

# Number of size changes of a moving object. Each size is another picture to draw.
_SIZES = 2
_HELD = {
    "front": (0.0, 0.18),
    "right": (0.35, 0.09),
    "left": (-0.35, 0.09),
    "back": (0.0, -0.58),
}


@dataclass(frozen=True, slots=True)
class Spot:
    """Centre of a picture in pixels, and the size of a tile there."""

    x: float
    y: float
    tile: float

    def up(self, tiles: float) -> Spot:
        """Return the spot some tiles higher."""
        return Spot(self.x, self.y - tiles * self.tile, self.tile)

    def towards(self, other: Spot, share: float) -> Spot:
        """Return a spot between two, with one of a few tile sizes."""
        return Spot(
            self.x + (other.x - self.x) * share,
            self.y + (other.y - self.y) * share,
            self.tile + (other.tile - self.tile) * round(share * _SIZES) / _SIZES,
        )


def sizes_of_tiles(tile: int) -> tuple[float, ...]:
    """Return the tile sizes in use: on stations, in hands, then on the way between the two."""
    full, held = float(tile), tile * _HELD_SCALE
    between = (held + (full - held) * n / _SIZES for n in range(1, _SIZES))
    return full, held, *between


def size_in(holder: float) -> int:
    """Return the size in pixels of an object that swims in a container of a size."""
    return max(1, round(_SWIMMING * holder))


def hands(layout: Layout, pose: Pose) -> Spot:
    """Return the spot of the lowest object that a player holds."""
    dx, dy = _HELD[pose.facing]
    x, y = layout.corner(pose.at)
    # Nothing sticks out of the kitchen.
    half = _HELD_SCALE * _SEEN / 2 * layout.tile
    left, right = layout.kitchen.left + half, layout.kitchen.right - half
    return Spot(
        min(max(x + (0.5 + dx) * layout.tile, left), right),
        y + (0.5 - RAISED + dy) * layout.tile,
        layout.tile * _HELD_SCALE,
    )


def pile_spot(
    layout: Layout, stage: SceneSprites, host: str, poses: dict[str, Pose]
) -> Spot | None:
    """Return the spot of the lowest object on a station, on the floor or in a player's hands."""
    if host in poses:
        return hands(layout, poses[host])
    tile = stage.placed[host].tile
    if tile is None:
        return None
    x, y = layout.corner(tile)
    return Spot(
        x + layout.tile / 2, y + (0.5 - stage.bases[host]) * layout.tile, float(layout.tile)
    )


def spots(layout: Layout, stage: SceneSprites, poses: dict[str, Pose]) -> dict[str, Spot]:
    """Return the spots of all players, stations and objects."""
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


def occupied(layout: Layout, stage: SceneSprites, poses: dict[str, Pose]) -> list[pygame.Rect]:
    """Return the areas that no label may cover: players, held objects, stations in use."""
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


def extent(
    layout: Layout, stage: SceneSprites, name: str, poses: dict[str, Pose]
) -> pygame.Rect | None:
    """Return the area of an object with everything on it, or None if it is not visible."""
    if name in poses:
        return player_area(layout, poses[name])
    placed = stage.placed.get(name)
    if placed is None or placed.tile is None:
        return None
    base = pile_spot(layout, stage, name, poses) if name in stage.piles else None
    pieces = stage.piles[name] if base is not None else ()
    return layout.cell(placed.tile).unionall([_covered(p, base) for p in pieces if base])


def player_area(layout: Layout, pose: Pose) -> pygame.Rect:
    """Return the area of a player."""
    return _part(layout.corner(pose.at), _BODY, layout.tile)


def workplaces(layout: Layout, stage: SceneSprites, plain: Collection[str]) -> list[pygame.Rect]:
    """Return the worktops of all stations except the plain ones."""
    tiles = (stage.placed[name].tile for name in stage.stations if name not in plain)
    return [_part(layout.corner(tile), _WORKTOP, layout.tile) for tile in tiles if tile is not None]


def ways(
    stage: SceneSprites,
    now: Mapping[str, Spot],
    earlier: Mapping[str, Spot],
    travels: Collection[str],
) -> list[pygame.Rect]:
    """Return the areas that moving objects pass through. They stay the same for the whole step."""
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
    """Return a part of a tile, given in tiles."""
    x, y, width, height = (value * tile for value in part)
    return pygame.Rect(round(corner[0] + x), round(corner[1] + y), round(width), round(height))
