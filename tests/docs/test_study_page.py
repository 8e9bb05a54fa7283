"""Run the commands of docs/run_a_study.md, and check the table of results."""

from __future__ import annotations

import csv
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from robotouille.replay import read_recording
from robotouille_data.database import database_url
from robotouille_data.query import asking
from tests.support.pages import read, titled
from tests.support.sources import ROOT
from tests.support.study_by_hand import activities, frames, useful_steps
from tests.support.worker_processes import lasting_ports

PAGE = read("run_a_study.md")
PROGRAMS = {
    "robotouille": "robotouille_client.cli.main",
    "robotouille-server": "robotouille_server.cli",
    "robotouille-token": "robotouille_server.auth.token_cli",
}
QUERY = (ROOT / "examples/study/table.sql").read_text(encoding="utf-8")
SECONDS = 240
ACTIVITIES = ("acted", "busy", "waiting", "idle", "away", "substituted")

needs_broker = pytest.mark.skipif(
    not all(
        shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin")
        for name in ("mosquitto", "mosquitto_sub")
    ),
    reason="Mosquitto is not installed",
)


def commands(section: str) -> list[str]:
    """Return the lines after the prompt in the console blocks without title of a section."""
    part = PAGE.partition(f"\n## {section}\n")[2].partition("\n## ")[0]
    found = re.findall(r"^( *)```console\n(.*?)^\1```$", part, re.DOTALL | re.MULTILINE)
    lines = [line.strip() for _, block in found for line in block.splitlines()]
    return [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]


def terminals() -> list[str]:
    """Return the commands that keep running, each in its own terminal."""
    return re.findall(r'^```console title="Terminal \d: [^"]*"\n\$ (.*)\n```$', PAGE, re.MULTILINE)


class Terminal:
    """Folder with the programs of the page, and free ports for them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        first = lasting_ports(2)
        self.port, self.broker = first, first + 1
        programs = folder / "programs"
        programs.mkdir()
        for name, module in PROGRAMS.items():
            self._write(programs / name, f'-c "from {module} import main; main()"')
        self._write(programs / "python", "")
        for name in ("examples", "lab"):
            (folder / name).symlink_to(ROOT / name)
        self.environment = {
            **os.environ,
            "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}{os.pathsep}/usr/sbin",
            "PYTHONUNBUFFERED": "1",
            "ROBOTOUILLE_PORT": str(self.port),
            "ROBOTOUILLE_OPERATOR": "false",
        }
        self.changes = {
            "mosquitto -p 1883": f"mosquitto -p {self.broker}",
            "mqtt://127.0.0.1": f"mqtt://127.0.0.1:{self.broker}",
            "mosquitto_sub -v": f"mosquitto_sub -p {self.broker} -v",
            "--out opened.csv --tokens": f"--out opened.csv --tokens --url ws://127.0.0.1:{self.port}",
            "--out novice.csv": f"--out novice.csv --url ws://127.0.0.1:{self.port}",
            "bots.py opened.csv": f"bots.py opened.csv --at-once 4 --url ws://127.0.0.1:{self.port}",
        }
        self.changed: set[str] = set()

    def _write(self, path: Path, words: str) -> None:
        path.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n')
        path.chmod(0o700)

    def here(self, command: str) -> str:
        """Return a command with the free ports."""
        for old, new in self.changes.items():
            if old in command:
                self.changed.add(old)
                command = command.replace(old, new)
        return command

    @contextmanager
    def running(self, command: str, ready: str) -> Iterator[Path]:
        """Start a command, wait until it prints `ready`, and yield the file with its output."""
        said = self.folder / f"{command.split(maxsplit=1)[0]}{len(list(self.folder.iterdir()))}.txt"
        words = ["bash", "-c", f"exec {self.here(command)}"]
        with said.open("w") as output:
            process = subprocess.Popen(
                words, cwd=self.folder, env=self.environment, stdout=output, stderr=output
            )
        try:
            end = time.monotonic() + 60
            while ready not in said.read_text():
                assert process.poll() is None, said.read_text()
                assert time.monotonic() < end, said.read_text()
                time.sleep(0.02)
            yield said
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(timeout=30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def run(self, lines: list[str]) -> str:
        """Run commands in order and return their output."""
        script = "\n".join(map(self.here, lines))
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", script],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=SECONDS,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout


READY = {
    "mosquitto": "running",
    "robotouille-server": "stop:",
    "mosquitto_sub": "/presence",
    "robotouille": "",
}


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, str, Path]]:
    """Return the folder of the study, the output of its commands, and the file of live events."""
    folder = tmp_path_factory.mktemp("lab")
    terminal = Terminal(folder)
    with ExitStack() as stack:
        outputs = {
            command.split()[0]: stack.enter_context(
                terminal.running(command, READY[command.split()[0]])
            )
            for command in terminals()
        }
        printed = terminal.run(
            [*commands("Run the example study"), *commands("Back up and restore")]
        )
    assert terminal.changed == terminal.changes.keys()
    yield folder, printed, outputs["mosquitto_sub"]


pytestmark = [pytest.mark.process, pytest.mark.slow, needs_broker]


def test_the_table_matches_the_recordings(study: tuple[Path, str, Path]) -> None:
    folder, printed, _ = study
    with (folder / "table.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    rows = {(row["episode"], row["player"]): row for row in table}
    expected = {
        (row["episode"], row["player"]): row
        for path in (folder / "recordings").glob("*.rbt")
        for row in by_hand(frames(path.read_bytes()))
    }
    assert len(table) == len(rows) == len(expected) == 40
    for key, row in expected.items():
        found = rows[key]
        assert {name: found[name] for name in row if name != "decision_ms"} == {
            name: str(value) for name, value in row.items() if name != "decision_ms"
        }
        if row["decision_ms"] is None:
            assert found["decision_ms"] == ""
        else:
            assert float(found["decision_ms"]) == pytest.approx(row["decision_ms"], abs=0.5)
    assert Counter(row["condition"] for row in table) == {"expert": 20, "novice": 20}
    assert sum(int(row["away"]) > 0 for row in table) == 10
    assert all(int(row["chat"]) for row in table)
    assert table[0]["episode"] in printed


def test_experts_act_again_after_they_return(study: tuple[Path, str, Path]) -> None:
    for path in (study[0] / "recordings").glob("*.rbt"):
        recorded = frames(path.read_bytes())
        if recorded[0]["labels"]["condition"] == "expert":
            did = [seats for _, seats in activities(recorded)]
            for player in {player for step in did for player in step if step[player] == "away"}:
                course = [step[player] for step in did]
                assert "acted" in course[course.index("away") :]


def by_hand(recorded: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Compute the rows of an episode from its frames alone."""
    labels, outcome = recorded[0]["labels"], recorded[-1]["outcome"]
    steps = [frame for frame in recorded if frame["kind"] == "step"]
    notes = [note for frame in recorded for note in frame.get("notes", ())]
    asked = Counter((note.get("player"), note["note"]) for note in notes)
    did = dict(activities(recorded))
    useful = Counter((player, could) for _, player, could in useful_steps(recorded))
    for seat in outcome["seats"]:
        player = seat["player"]
        counted = Counter(seats[player] for seats in did.values())
        assert {name: counted[name] for name in ACTIVITIES} == {
            name: seat[name] for name in ACTIVITIES
        }
        moves = [
            (frame["step"], move["seq"] > 0, str(place) in frame.get("unmet", {}), move["ms"])
            for frame in steps
            for place, move in enumerate(frame["moves"])
            if move["player"] == player
        ]
        times = [
            ms for step, own, lost, ms in moves if own and not lost and did[step][player] == "acted"
        ]
        yield {
            "condition": labels["condition"],
            "pair": labels["pair"],
            "episode": recorded[0]["episode"],
            "player": player,
            "outcome": outcome["reason"],
            "steps": len(steps),
            **{name: counted[name] for name in ("acted", "busy", "away")},
            "unused": useful[player, True],
            "hindered": useful[player, False],
            "waits": sum(player in frame.get("waits", ()) for frame in steps),
            "rejections": asked[player, "rejected"]
            + sum(own and lost for _, own, lost, _ in moves),
            "chat": asked[player, "said"],
            "decision_ms": sum(times) / len(times) if times else None,
        }


def test_the_page_and_the_example_have_the_same_query(study: tuple[Path, str, Path]) -> None:
    assert titled("run_a_study.md", "table.sql") == QUERY
    folder = study[0] / "recordings"
    with asking(database_url(None, folder), QUERY) as answer:
        shown = titled("run_a_study.md", "first rows").split("\n")[0].split()
        assert list(answer.columns) == shown


def test_only_the_researcher_can_read_tokens(study: tuple[Path, str, Path]) -> None:
    folder = study[0]
    assert (folder / "opened.csv").stat().st_mode & 0o077 == 0
    with (folder / "opened.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len({row["code"] for row in rows}) == len(rows) == 20
    assert all(row["token.robot1"] and row["token.robot2"] for row in rows)


def test_conditions_are_balanced() -> None:
    with (ROOT / "examples/study/pairs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    counted = Counter((row["label.condition"], row["label.round"]) for row in rows)
    assert set(counted.values()) == {5}
    assert len({(row["label.pair"], row["label.condition"]) for row in rows}) == 20
    breaks = [row for row in rows if row["label.line"] == "breaks"]
    for label in ("label.condition", "label.round"):
        assert set(Counter(row[label] for row in breaks).values()) == {5}


def test_the_broker_published_the_end_of_every_episode(study: tuple[Path, str, Path]) -> None:
    folder, _, events = study
    lines = events.read_text().splitlines()
    ended = {line.split("/")[4] for line in lines if "/life {" in line and '"ended"' in line}
    recorded = {
        read_recording(path).header["episode"] for path in (folder / "recordings").glob("*.rbt")
    }
    assert ended == recorded


def test_the_backup_was_restored(study: tuple[Path, str, Path]) -> None:
    folder = study[0]
    old, new = (
        {path.name: path.read_bytes() for path in (folder / place).glob("*.rbt")}
        for place in ("recordings", "elsewhere/recordings")
    )
    assert old == new
    assert len(new) == 20
