"""A Node program written from the documentation reads recordings."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille.replay.container import read_frames
from tests.conformance.node import run_node
from tests.support.games import recorded_game

pytestmark = pytest.mark.process


@pytest.mark.parametrize("cut", [0, 1, 700])
def test_node_and_python_read_the_same_frames(tmp_path: Path, cut: int) -> None:
    stream = recorded_game("multi_agent/10@3", seed=2, steps=110)
    path = tmp_path / "game.rbt.part"
    path.write_bytes(stream[: len(stream) - cut])
    found = run_node("recording", path=str(path))
    assert found["version"] == 3
    assert found["frames"] == list(read_frames(stream[: len(stream) - cut]))
    assert len(found["frames"]) > 110
