"""Players are seen walking over the floor's free tiles."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import pytest

from robotouille import State, Timing, World, load_task
from robotouille.world.scene import scene
from robotouille_client.window.drawing.kitchen.motion import Motion, Pose, along


def poses(motion: Motion, course: list[State], step: int, phase: float) -> Pose:
    before = scene(course[step - 1]) if step else None
    return motion.poses(course[step], scene(course[step]), before, step, phase)["robot1"]


def on_path(point: tuple[float, float], path: list[tuple[int, int]]) -> bool:
    """Whether a point is on one of the straight legs between neighbouring tiles."""
    return any(
        math.dist(a, point) + math.dist(point, b) == pytest.approx(1) for a, b in pairwise(path)
    )


def test_a_walk_of_one_step_follows_the_path(play) -> None:
    world = World("asynchronous/09")
    course = play(world, "move table2")
    path = world.floor.path((5, 1), scene(course[1])["robot1"].tile)
    motion = Motion(world.floor)
    seen = [poses(motion, course, 1, i / 20) for i in range(21)]
    assert len(path) > 4
    assert seen[0].at == path[0]
    assert seen[-1] == Pose(path[-1], "front")
    assert all(on_path(pose.at, path) for pose in seen)
    assert all(pose.walking for pose in seen[:-1])


def test_a_walk_of_many_steps_lasts_until_the_player_is_free(play) -> None:
    world = World(load_task("asynchronous/09", timing=Timing.PEOPLE))
    course = play(world, "move table2", *"-" * 12)
    steps = 1 + course[1].busy_steps("robot1")
    path = world.floor.path((5, 1), scene(course[1])["robot1"].tile)
    assert steps == len(path) - 1
    motion = Motion(world.floor)
    seen = [poses(motion, course, step, phase) for step in range(1, 13) for phase in (0, 0.5)]
    assert all(on_path(pose.at, path) for pose in seen)
    for tile, step in zip(path, range(1, steps + 2), strict=True):
        assert seen[2 * (step - 1)].at == pytest.approx(tile)
    assert not seen[2 * steps].walking


def test_skipping_steps_ends_a_walk(play) -> None:
    world = World(load_task("asynchronous/09", timing=Timing.PEOPLE))
    course = play(world, "move table2", *"-" * 4)
    motion = Motion(world.floor)
    poses(motion, course, 1, 0.5)
    assert poses(motion, course, 4, 0.5).at == scene(course[4])["robot1"].tile


def test_who_stands_faces_its_station() -> None:
    world = World("asynchronous/09")
    assert poses(Motion(world.floor), [world.initial], 0, 1.0) == Pose((5, 1), "front")


def test_along_a_path_of_one_tile() -> None:
    assert along(((2, 3),), 0.5)[0] == (2, 3)


def test_players_on_one_tile_stand_side_by_side() -> None:
    world = World("multi_agent/09")
    now = scene(world.initial)
    first, second = world.players[:2]
    now[second] = dataclasses.replace(now[second], tile=now[first].tile)
    found = Motion(world.floor).poses(world.initial, now, None, 0, 1.0)
    assert found[first].at[1] == found[second].at[1]
    assert found[second].at[0] - found[first].at[0] == pytest.approx(0.5)
