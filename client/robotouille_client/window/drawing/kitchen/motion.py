"""Where players are between two states: they walk, tile by tile, for as long as a move takes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from robotouille.world.grounding.floor import Floor, Tile
from robotouille.world.scene import Placed
from robotouille.world.world import State

__all__ = ["Motion", "Pose", "along"]

Point = tuple[float, float]

_SIDE_BY_SIDE = 0.5


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a player is drawn, and which way it looks; `stride` runs from 0 to 1 on each tile."""

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
    """The point of a path after a share of it, the direction there and the share of its tile."""
    legs = len(path) - 1
    if legs < 1:
        return path[0], (0, 0), 0.0
    leg = min(legs - 1, int(share * legs))
    rest = share * legs - leg
    (x, y), (to_x, to_y) = path[leg], path[leg + 1]
    return (x + (to_x - x) * rest, y + (to_y - y) * rest), (to_x - x, to_y - y), rest


def looking(direction: tuple[int, int]) -> str:
    """The side of a player that the viewer sees when it looks along a vector."""
    dx, dy = direction
    if abs(dx) > abs(dy):
        return "right" if dx > 0 else "left"
    return "back" if dy > 0 else "front"


class Motion:
    """Remembers the walks that are under way.

    A walk that takes several steps begins where the player was seen before it, and ends when the
    player is no longer busy. When steps are skipped, players are simply where they are.
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
        """The pose of each player, `phase` of the way from the state before to `state`."""
        if state is not self._state or step != self._step:
            self._advance(state, now, before or now, step)
        poses = {}
        for name in state.world.players:
            placed = now.get(name)
            if placed is not None and placed.tile is not None:
                poses[name] = self._pose(placed, self._walks.get(name), step, phase)
        return _apart(poses)

    def walking(self, step: int) -> bool:
        """Whether somebody is on the way during a step, the one last asked for poses of."""
        return any(walk.share(step, 0.0) < 1.0 for walk in self._walks.values())

    def _advance(
        self, state: State, now: dict[str, Placed], before: dict[str, Placed], step: int
    ) -> None:
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
    """Players who have to share a tile stand side by side on it."""
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
