"""Two people play the first multi-agent task: real windows, a real mouse and real keys.

A server process in real time, and two `robotouille-client` processes under Xvfb that join by code
and that xdotool controls. A spectator's connection shows when an action has taken effect.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille import World, load_task
from robotouille.installation import data_folder
from robotouille.planning.plan import read_plan
from robotouille.planning.policies.policy import Script
from robotouille.replay.recording import read_recording
from robotouille_client import Game, StateChanged, connect
from tests.support.processes import process

TASK = "multi_agent/01_lettuce_burger"

pytestmark = [
    pytest.mark.browser,
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(
        not (shutil.which("Xvfb") and shutil.which("xdotool")), reason="needs Xvfb and xdotool"
    ),
]


def client(display: str, url: str, code: str, seat: str, picture: Path) -> subprocess.Popen[bytes]:
    program = "from robotouille_client.window.cli import main; main()"
    arguments = [code, "--url", url, "--name", f"person-{seat}", "--seat", seat]
    arguments += ["--linger", "1", "--screenshot", str(picture)]
    environment = {**os.environ, "DISPLAY": display, "SDL_VIDEODRIVER": "x11"}
    return subprocess.Popen([sys.executable, "-c", program, *arguments], env=environment)


async def cook(url: str, code: str, people: dict[str, Any]) -> dict[str, Any]:
    """Act through the windows until the goal is reached."""
    async with connect(url, name="eye") as eye:
        game = await eye.join(code, role="spectator")
        rehearsal = World(load_task(TASK, seats=2))
        text = (data_folder("problems") / f"{TASK}@2.plan").read_text()
        plan = read_plan(text, rehearsal)
        scripts = {p: Script(p, plan, rehearsal.initial) for p in people}
        async with asyncio.timeout(400):
            while not game.running:
                await game.next_event()
            await asyncio.sleep(1.0)
            while not game.ended:
                await look(game, scripts)
                for player, person in people.items():
                    if game.running and not game.state.busy_steps(player):
                        action = scripts[player].act(game.state)
                        if action is not None:
                            await asyncio.to_thread(person.do, action)
        return game.outcome or {}


async def look(game: Game, scripts: dict[str, Script]) -> None:
    """Wait for a few steps, because people are slower than messages."""
    for _ in range(3):
        event = await game.next_event()
        if isinstance(event, StateChanged):
            for script in scripts.values():
                script.observe(event.did)
        if game.ended:
            return


def test_two_people_finish_the_first_task(tmp_path: Path) -> None:
    from tests.support.person import Person
    from tests.support.screens import open_screen

    flags = ("--mode", "realtime", "--step-rate", "10", "--task", TASK, "--max-steps", "6000")
    world = World(load_task(TASK, seats=2))
    pictures = {player: tmp_path / f"{player}.png" for player in world.players}
    with ExitStack() as stack:
        _, url, code = stack.enter_context(process(tmp_path / "recordings", *flags))
        people, windows = {}, []
        for player in world.players:
            display = stack.enter_context(open_screen(tmp_path / player)).display
            people[player] = Person(display, world)
            window = client(display, url, code, player, pictures[player])
            stack.callback(window.kill)
            windows.append(window)
        outcome = asyncio.run(cook(url, code, people))
        assert [window.wait(timeout=30) for window in windows] == [0, 0]
    assert outcome["reason"] == "goal", outcome
    (file,) = (tmp_path / "recordings").glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    assert {kind for _, kind in recording.participants.values()} == {"human"}
    for picture in pictures.values():
        assert picture.stat().st_size > 20_000
