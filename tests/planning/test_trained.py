"""Trained policies play from files with NumPy alone."""

from __future__ import annotations

import io
import os
import struct
import tracemalloc
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robotouille import FileError, RobotouilleError, World
from robotouille.planning.policies.lockstep import play_in_lockstep
from robotouille.planning.policies.trained import (
    Actor,
    TrainedPolicy,
    layout_of,
    read_actor,
    write_actor,
)

WEIGHTS = Path(__file__).parents[2] / "examples/learning/weights"


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


@pytest.mark.parametrize("path", sorted(WEIGHTS.glob("*.npz")), ids=lambda path: path.stem)
def test_shipped_policies_cook_with_themselves(path: Path) -> None:
    actor = read_actor(path)
    start = World(actor.task).initial
    team = {p: TrainedPolicy(actor, start, p, seed=1) for p in start.world.players}
    plan, last = play_in_lockstep(start, team, 20)
    assert last.goal_reached
    assert len(plan) <= 18


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


def file_with(path: Path, entries: dict[str, object], packing: int = zipfile.ZIP_DEFLATED) -> None:
    """Write an actor's file in which some entries are replaced. Bytes are the whole entry."""
    write_actor(path, eager(World("training/03@2"), "move"))
    with np.load(path) as arrays:
        found: dict[str, Any] = {name: arrays[name] for name in arrays.files} | entries
    with zipfile.ZipFile(path, "w", packing) as archive:
        for name, value in found.items():
            content = io.BytesIO(value if isinstance(value, bytes) else b"")
            if not isinstance(value, bytes):
                np.save(content, np.asarray(value))
            archive.writestr(f"{name}.npy", content.getvalue())


def entry(shape: str, kind: str = "<f2", content: bytes = b"") -> bytes:
    """Return an array that declares a shape and has other content."""
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + content


@pytest.mark.parametrize(
    "entries",
    [
        {"weights0": entry("(1000000, 1000000)")},
        {"weights0": entry(f"({10**20}, 3)")},
        {"weights0": b"no array"},
        {"weights0": entry("(True, False)")},
        {"weights0": b"\x93NUMPY\x01\x00" + (9_000).to_bytes(2, "little") + b"[" * 9_000},
        {"weights0": np.zeros((3, 3), complex)},
        {"weights1": np.zeros((3, 3)), "biases1": np.float32(1)},
        {"version": np.arange(3)},
        {"version": np.inf},
        {"scale": np.full(World("training/03@2").encoding.size, np.nan, np.float32)},
        {"name": entry("()", "<U1", b"\xff\xff\xff\xff")},
        {"name": np.array(["a", "b"])},
        {"columns": np.zeros((2, 0), np.int32)},
    ],
)
def test_hostile_arrays_are_refused(entries: dict[str, object], tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    file_with(path, entries)
    with pytest.raises(FileError, match="not a trained policy") as raised:
        read_actor(path)
    assert "\n" not in str(raised.value)


def test_hostile_archives_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    file_with(path, {}, zipfile.ZIP_LZMA)
    with pytest.raises(FileError, match="compressed in another way"):
        read_actor(path)
    file_with(path, {"more": np.zeros(65 << 20, np.uint8)})
    with pytest.raises(FileError, match="arrays are larger than 64 MiB"):
        read_actor(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.comment = b"The end of the archive could be anywhere."
    with pytest.raises(FileError, match="not a trained policy"):
        read_actor(path)
    file_with(path, {})
    content = bytearray(path.read_bytes())
    content[len(content) // 3 : len(content) // 2] = b"\xff" * (
        len(content) // 2 - len(content) // 3
    )
    path.write_bytes(content)
    with pytest.raises(FileError, match="not a trained policy"):
        read_actor(path)
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(FileError, match="not a regular file"):
        read_actor(tmp_path / "pipe.npz")


def archive_of(entries: int, *, large: bool) -> bytes:
    """Return an archive whose list names one entry again and again."""
    listed = b"PK\1\2" + bytes(24) + b"\5" + bytes(17) + b"a.npy"
    size = len(listed) * entries
    if not large:
        return listed * entries + struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, 1, 1, size, 0, 0)
    record = struct.pack("<4sQ2H2L4Q", b"PK\6\6", 44, 45, 45, 0, 0, entries, entries, size, 0)
    locator = struct.pack("<4sLQL", b"PK\6\7", 0, size, 1)
    end = struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, *[0xFFFF] * 2, *[0xFFFFFFFF] * 2, 0)
    return listed * entries + record + locator + end


@pytest.mark.parametrize("large", [False, True])
def test_entries_of_an_archive_are_not_read_if_there_are_many(tmp_path: Path, large: bool) -> None:
    """A file of 60 MiB took more than half a gigabyte of memory."""
    path = tmp_path / "many.npz"
    path.write_bytes(archive_of(20_000, large=large))
    tracemalloc.start()
    with pytest.raises(FileError, match="more than 200 arrays"):
        read_actor(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 200_000


def test_networks_of_another_shape_are_refused() -> None:
    world = World("training/03@2")
    actor = eager(world, "move")
    (weights, biases), columns, scale = actor.layers[0], actor.columns, actor.scale
    for wrong in (
        replace(actor, layers=((weights[:, 1:], biases[1:]),)),
        replace(actor, columns=columns[:1], layers=((weights[1:], biases),)),
        replace(actor, columns=columns[:, :5], scale=scale[:5], layers=((weights[:7], biases),)),
    ):
        with pytest.raises(RobotouilleError, match="the network does not fit training/03"):
            TrainedPolicy(wrong, world.initial, "robot1")


def test_network_of_large_numbers_ends_with_a_message() -> None:
    world = World("training/03@2")
    actor = eager(world, "move")
    weights, biases = actor.layers[0]
    large = replace(actor, layers=((np.full_like(weights, 3e38), biases),))
    policy = TrainedPolicy(large, world.initial, "robot1")
    with pytest.raises(RobotouilleError, match="numbers are too large"):
        policy.act(world.initial)
