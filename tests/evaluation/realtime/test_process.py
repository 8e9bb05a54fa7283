"""`robotouille-bot llm` and a server, each a process, in real time."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_evaluation.metrics import Trajectory
from tests.support.server_process import server_process

BOT = [sys.executable, "-c", "from robotouille_client.bots.cli import main; main()", "llm"]
OPTIONS = ["--helper", "planner", "--late", "revalidate", "--digest-tokens", "50", "--json"]


@pytest.mark.process
@pytest.mark.nightly
async def test_a_model_and_its_helper_finish_a_game(tmp_path: Path) -> None:
    with server_process(tmp_path) as server:
        async with connect(server.url, name="host") as client:
            opened = await client.create(
                "synchronous/01_cheese_sandwich", clock="realtime", step_rate=5.0, max_steps=300
            )
        command = [*BOT, "--url", server.url, "--episode", opened.code, *OPTIONS]
        played = subprocess.run(command, capture_output=True, text=True, timeout=240)
        assert played.returncode == 0, played.stderr
        assert json.loads(played.stdout)["reason"] in ("goal", "step_limit")
        (file,) = server.recordings.glob("*.rbt")
        recording = read_recording(file)
        assert recording.verify().identical
        course = Trajectory.recorded(recording)
        assert course.thoughts
        assert all(answer.step >= (answer.basis or 0) for answer in course.answers)
