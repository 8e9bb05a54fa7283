"""Trained policies play from files with NumPy alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robotouille import FileError, RobotouilleError, World
from robotouille.planning.policies.trained import (
    Actor,
    TrainedPolicy,
    layout_of,
    read_actor,
    write_actor,
)


def eager(world: World, action: str) -> Actor:
    """Return an actor that prefers the actions of one name, and else does nothing."""
    actions = world.ground_actions("robot1")
    size = world.encoding.size
    biases = np.array([8.0 * (a.name == action) for a in actions] + [4.0], np.float32)
    weights = np.zeros((size + 2, len(biases)), np.float32)
    columns = np.tile(np.arange(size, dtype=np.int32), (2, 1))
    scale = np.ones(size, np.float32)
    layout = layout_of(world.encoding, world.players)
    return Actor("eager", "training/03@2", layout, columns, scale, ((weights, biases),))


def test_policy_from_a_file_takes_valid_actions_that_its_network_prefers(tmp_path: Path) -> None:
    world = World("training/03@2")
    write_actor(tmp_path / "eager.npz", eager(world, "cook"))
    actor = read_actor(tmp_path / "eager.npz")
    policy = TrainedPolicy(actor, world.initial, "robot2", greedy=True)
    assert policy.act(world.initial) is None
    write_actor(tmp_path / "eager.npz", eager(world, "move"))
    policy = TrainedPolicy(read_actor(tmp_path / "eager.npz"), world.initial, "robot2", seed=3)
    actions = [policy.act(world.initial) for _ in range(20)]
    moves = {action for action in actions if action is not None and action.name == "move"}
    assert len(moves) > 1
    assert moves <= set(world.initial.actions("robot2"))
    again = TrainedPolicy(actor, world.initial, "robot2", seed=3)
    assert [again.act(world.initial) for _ in range(3)] == [None] * 3


def test_policy_of_another_kitchen_is_refused() -> None:
    actor = eager(World("training/03@2"), "move")
    other = World("multi_agent/01@2")
    with pytest.raises(RobotouilleError, match="was trained for training/03@2 and cannot play"):
        TrainedPolicy(actor, other.initial, "robot1")


def test_other_durations_do_not_matter() -> None:
    from robotouille import load_task

    world = World(load_task("training/03@2", timing="people"))
    TrainedPolicy(eager(World("training/03@2"), "move"), world.initial, "robot1")


def test_files_that_are_no_actors_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    for content in (b"", b"PK\x03\x04", b"no archive"):
        path.write_bytes(content)
        with pytest.raises(FileError, match="not a trained policy"):
            read_actor(path)
    with pytest.raises(FileError, match="cannot be read"):
        read_actor(tmp_path / "missing.npz")
    np.savez(path, version=np.array([None]), allow_pickle=True)
    with pytest.raises(FileError, match="not a trained policy"):
        read_actor(path)
    actor = eager(World("training/03@2"), "move")
    (weights, biases), columns = actor.layers[0], actor.columns
    for wrong in (
        replace(actor, layers=((weights[1:], biases),)),
        replace(actor, layers=((weights * np.nan, biases),)),
        replace(actor, columns=columns + 1),
        replace(actor, scale=actor.scale[1:]),
    ):
        write_actor(path, wrong)
        with pytest.raises(FileError, match="not a trained policy"):
            read_actor(path)
