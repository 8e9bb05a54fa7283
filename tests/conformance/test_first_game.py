"""The JavaScript client of docs/protocol.md plays a whole game."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from robotouille.replay.container import read_frames
from tests.conformance.node import run_node
from tests.support.games import recorded_game
from tests.support.pages import titled
from tests.support.server_process import ServerProcess

pytestmark = pytest.mark.process

FLAG = "--experimental-websocket"
"""Enables the global `WebSocket` in Node 20. Later versions need no flag."""


def has_websocket() -> bool:
    if shutil.which("node") is None:
        return False
    command = ["node", FLAG, "--eval", "WebSocket"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


@pytest.mark.skipif(not has_websocket(), reason="Node 20.10 or newer is not installed")
def test_first_game_ends_with_an_outcome(server: ServerProcess, tmp_path: Path) -> None:
    program = tmp_path / "first_game.mjs"
    program.write_text(titled("protocol.md", program.name), encoding="utf-8")
    command = ["node", FLAG, str(program), server.url]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    outcome = json.loads(done.stdout)
    assert outcome["steps"] == 30
    assert outcome["seats"][0]["acted"] > 20


@pytest.mark.parametrize("cut", [0, 1, 700])
def test_node_and_python_read_the_same_frames(tmp_path: Path, cut: int) -> None:
    stream = recorded_game("multi_agent/10@3", seed=2, steps=110)
    path = tmp_path / "game.rbt.part"
    path.write_bytes(stream[: len(stream) - cut])
    found = run_node("recording", path=str(path))
    assert found["version"] == 3
    assert found["frames"] == list(read_frames(stream[: len(stream) - cut]))
    assert len(found["frames"]) > 110
