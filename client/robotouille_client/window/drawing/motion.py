"""Positions of players between two states. A walk takes as long as its move."""

from __future__ import annotations

from dataclasses import dataclass, replace

from robotouille.world.grounding.floor import Floor, Tile
from robotouille.world.scene import Placed
from robotouille.world.world import State

Point = tuple[float, float]

_SIDE_BY_SIDE = 0.5


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
    """Place players that share a tile side by side."""
    sharing: dict[Point, list[str]] = {}
    for name, pose in poses.items():
        sharing.setdefault(pose.at, []).append(name)
    for (x, y), names in sharing.items():
        if len(names) > 1:
            gap = _SIDE_BY_SIDE / (len(names) - 1)
            for i, name in enumerate(names):
                at = (x - _SIDE_BY_SIDE / 2 + i * gap, y)
                poses[name] = replace(poses[name], at=at)
    return poses
