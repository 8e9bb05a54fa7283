"""Commands as users type them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

from robotouille import task_names
from robotouille.installation import data_folder
from robotouille.replay.recording import read_recording
from robotouille_client.cli.main import app
from robotouille_client.window.cli import command as client
from tests.support.games import recorded_game
from tests.support.processes import process


def robotouille(*words: str) -> Result:
    return CliRunner().invoke(app, list(words))


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "game.rbt"
    path.write_bytes(recorded_game("multi_agent/01", steps=12))
    return path


def test_tasks_are_listed_with_seats_and_goals() -> None:
    rows = json.loads(robotouille("tasks", "--json").stdout)
    assert [row["task"] for row in rows] == list(task_names())
    row = next(r for r in rows if r["task"] == "multi_agent/01_lettuce_burger")
    assert row["seats"] == [2, 3, 4]
    assert "burger" in row["goal"]
    assert "multi_agent/01" in robotouille("tasks").stdout


def test_text_prints_the_first_observation() -> None:
    text = robotouille("text", "synchronous/01").stdout
    assert text.startswith("Station ")
    assert "\nValid Actions:\n" in text
    assert robotouille("text", "synchronous/99").exit_code == 1


@pytest.mark.parametrize("command", ["play", "plan", "text", "generate"])
def test_commands_refuse_kitchens_with_faults(tmp_path: Path, command: str) -> None:
    path = tmp_path / "mine.json"
    raw = json.loads((data_folder("problems") / "synchronous/01_cheese_sandwich.json").read_text())
    path.write_text(json.dumps(raw))
    assert robotouille("text", str(path)).exit_code == 0
    raw["players"][0]["direction"] = [1, 0]
    path.write_text(json.dumps(raw))
    refused = robotouille(command, str(path))
    assert refused.exit_code == 1
    assert refused.output.startswith(f"{path}: players[0]: robot1 faces")
    assert "players start at a station" in refused.output


def test_replay_info_and_verify(recording: Path) -> None:
    info = json.loads(robotouille("replay", "info", str(recording), "--json").stdout)
    assert info["steps"] == 12
    assert info["outcome"]["reason"] == "step_limit"
    verified = robotouille("replay", "verify", str(recording))
    assert (verified.exit_code, "verified, 12 steps" in verified.stdout) == (0, True)
    recording.write_bytes(recording.read_bytes()[:-30])
    assert "cut off" in robotouille("replay", "verify", str(recording)).stdout
    damaged = bytearray(recording.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    recording.write_bytes(damaged)
    refused = robotouille("replay", "verify", str(recording))
    assert refused.exit_code == 1
    assert "damaged at byte" in refused.output


def test_replay_export(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "game.jsonl"
    assert robotouille("replay", "export", str(recording), "--out", str(out)).exit_code == 0
    lines = [json.loads(line) for line in out.read_text().splitlines()]
    kinds = [line["kind"] for line in lines]
    assert [k for k in kinds if k != "note"] == ["header", *["step"] * 12, "outcome"]
    notes = {line["note"]["note"] for line in lines if line["kind"] == "note"}
    assert notes >= {"roster", "started"}


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["replay", "info", "no-such.rbt"], "cannot be read"),
        (["replay", "video", "RECORDING", "film.avi"], ".mp4 or .gif"),
        (["replay", "video", "RECORDING", "film.mp4", "--size", "big"], "WIDTHxHEIGHT"),
        (["lint", "no-such.json"], "No such file"),
        (["play", "no/such"], "no task or file"),
        (["play", "synchronous/01", "--timing", "sundial"], "unknown profile"),
    ],
)
def test_invalid_arguments_are_explained(recording: Path, words: list[str], reason: str) -> None:
    done = robotouille(*[str(recording) if w == "RECORDING" else w for w in words])
    assert done.exit_code == 1
    assert reason in done.output
    assert "Traceback" not in done.output


def test_seed_that_no_recording_can_store_is_refused() -> None:
    done = robotouille("play", "synchronous/01", "--seed", "9" * 35)
    assert done.exit_code == 2
    assert "--seed" in done.output


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--mode", "turns"], "unknown value 'turns'; did you mean 'turn'? (possible: turn, lock"),
        (["--partner", "plan"], "unknown value 'plan' (possible: partner, learner"),
    ],
)
def test_unknown_values_suggest_the_nearest(words: list[str], reason: str) -> None:
    done = robotouille("play", "synchronous/01", *words)
    assert done.exit_code == 2
    assert reason in " ".join(done.stderr.replace("│", " ").split())


def test_unknown_value_of_the_window_suggests_the_nearest() -> None:
    window = typer.Typer()
    window.command()(client)
    done = CliRunner().invoke(window, ["--create", "synchronous/01", "--absence", "bots"])
    assert done.exit_code == 2
    assert "did you mean 'bot'?" in " ".join(done.stderr.replace("│", " ").split())


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("a.png", b"\x89PNG\r\n\x1a\n", "a PNG picture"),
        ("folder", None, "a folder"),
        ("folder.json", None, "a folder"),
        ("empty", b"", "an empty file"),
        ("a.dat", bytes(range(256)), "a binary file"),
        ("game.rbt", b"RBTL\x03", "a recording"),
    ],
)
@pytest.mark.parametrize("command", ["play", "text", "plan", "lint"])
def test_other_files_than_problems_are_named(
    tmp_path: Path, command: str, name: str, content: bytes | None, kind: str
) -> None:
    path = tmp_path / name
    path.mkdir() if content is None else path.write_bytes(content)
    done = robotouille(command, str(path))
    assert done.exit_code == 1
    assert f"{path}: " in done.output
    assert f"is {kind}; expected " in done.output


def test_other_files_than_recordings_are_named(tmp_path: Path) -> None:
    picture = tmp_path / "a.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n")
    done = robotouille("replay", "info", str(picture))
    assert f"{picture}: not a recording but a PNG picture; the server writes" in done.output
    done = robotouille("replay", "verify", str(tmp_path))
    assert f"{tmp_path}: is a folder; expected a recording (.rbt)" in done.output


def bot(url: str, code: str, name: str, **environment: str) -> subprocess.Popen[str]:
    program = "from robotouille_client.bots.cli import main; main()"
    words = ["planner", "--url", url, "--episode", code, "--name", name, "--json"]
    return subprocess.Popen(
        [sys.executable, "-c", program, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )


@pytest.mark.slow
@pytest.mark.process
def test_bots_as_processes_cook_together(tmp_path: Path) -> None:
    flags = ("--task", "multi_agent/01", "--mode", "realtime", "--step-rate", "20")
    with process(tmp_path, *flags) as (_, url, code):
        bots = [bot(url, code, name, XDG_STATE_HOME=str(tmp_path)) for name in ("ada", "bob")]
        outcomes = [json.loads(each.communicate(timeout=90)[0]) for each in bots]
    assert [outcome["reason"] for outcome in outcomes] == ["goal", "goal"]
    (file,) = tmp_path.glob("*.rbt")
    assert read_recording(file).verify().ok


@pytest.mark.process
def test_bot_prints_the_seats_it_waits_for(tmp_path: Path) -> None:
    flags = ("--task", "multi_agent/01", "--mode", "turn", "--max-steps", "2")
    home = {"XDG_STATE_HOME": str(tmp_path)}
    with process(tmp_path, *flags) as (_, url, code):
        first = bot(url, code, "ada", **home)
        assert first.stderr is not None
        assert f"ada plays robot1 in {code}" in first.stderr.readline()
        assert "robot1 waits for robot2" in first.stderr.readline()
        second = bot(url, code, "bob", **home)
        for each in (first, second):
            assert json.loads(each.communicate(timeout=90)[0])["steps"] == 2
