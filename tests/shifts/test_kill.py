"""A shift of two people and two bots on a real server that is killed with -9."""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from robotouille import State
from robotouille.replay import read_recording
from robotouille_client import connect
from robotouille_client.bots import play
from robotouille_client.window.replay.histories.recorded_history import RecordedHistory
from tests.programs.drill.server import ServerProcess, free_port
from tests.support.lost_connections import cut
from tests.support.processes import program
from tests.support.shifts import recomputed
from tests.support.team_games import RandomWalker

PROBLEM = Path(__file__).parents[2] / "problems" / "shifts" / "06_rush_hour.json"
STEPS = 160
BOTS = ("-c", "from robotouille_client.bots.cli import main; main()", "planner")


async def play_shift(folder: Path, server: ServerProcess) -> None:
    """Let two people and two bots play. Cut a person's connection, then kill the server."""
    await server.start()
    await server.listening.wait()

    def stroll(state: State, player: str) -> RandomWalker:
        return RandomWalker(player, seed=len(player))

    async with (
        connect(server.url, name="ada", kind="human") as ada,
        connect(server.url, name="ben", kind="human") as ben,
    ):
        created = await ada.create(
            "rush@4",
            # A busy machine must not take the bots the time in which they serve.
            clock="lockstep",
            timing="benchmark",
            absence="wait",
            grace=300.0,
        )
        games = [await person.join(created.code) for person in (ada, ben)]
        bots = [
            await asyncio.create_subprocess_exec(
                sys.executable, *BOTS, "--url", server.url, "--episode", created.code,
                "--name", name, "--skill", "expert", stdout=subprocess.DEVNULL,
            )
            for name in ("Chen", "Dara")
        ]  # fmt: skip
        playing = [asyncio.create_task(play(game, stroll)) for game in games]
        while games[0].step < STEPS // 4:
            await asyncio.sleep(0.05)
        cut(ben)
        while games[0].step < STEPS // 2:
            await asyncio.sleep(0.05)
        await server.kill(signal.SIGKILL)
        await server.start()
        await asyncio.gather(*playing, *(bot.wait() for bot in bots))
        assert [bot.returncode for bot in bots] == [0, 0]
    await server.kill(signal.SIGTERM)


@pytest.mark.process
@pytest.mark.slow
async def test_a_shift_of_four_survives_a_kill_and_its_score_is_right(tmp_path: Path) -> None:
    tasks = tmp_path / "tasks"
    tasks.mkdir()
    problem = json.loads(PROBLEM.read_text())
    problem["shift"]["steps"] = STEPS
    (tasks / "rush.json").write_text(json.dumps(problem))
    faults: list[str] = []
    server = ServerProcess(tmp_path, free_port(), faults, "--tasks", str(tasks))
    async with asyncio.timeout(120):
        await play_shift(tmp_path, server)
    assert not faults, faults
    assert server.lives == 2
    (path,) = (tmp_path / "recordings").glob("*.rbt")
    recording = read_recording(path)
    assert recording.verify().ok
    kinds = sorted(recording.participants.values())
    assert kinds == [("Chen", "bot"), ("Dara", "bot"), ("ada", "human"), ("ben", "human")]
    assert recording.outcome is not None
    score = recording.outcome["score"]
    assert (score["points"], score["served"], score["expired"]) == recomputed(recording)
    assert score["served"] >= 1
    history = RecordedHistory(recording)
    assert history.state(history.length).orders is not None
    exported = tmp_path / "game.jsonl"
    command = ("replay", "export", str(path), "--out", str(exported))
    with program("robotouille_client.cli.main", *command) as exporting:
        assert exporting.wait(60) == 0
    rows = [json.loads(line) for line in exported.read_text().splitlines()]
    assert len(rows) >= STEPS
    assert rows[-1]["score"] == score
