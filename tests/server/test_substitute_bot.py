"""A stand-in is ready before it is needed, and acts in the next step also where time runs."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from robotouille.replay.recording import read_recording
from robotouille_server import Server
from robotouille_server.rooms.substitutes.bot_worker import ThreadBotWorker
from tests.support.executors import ImmediateExecutor
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import run


async def begin(server: Server, ada: Raw, bob: Raw, **options: Any) -> str:
    """Both have joined a new game; its code."""
    request = {"type": "create", "absence": "bot", "stand_in": "planner", **options}
    code: str = (await ada.ask(request, "created"))["code"]
    for one in (ada, bob):
        await one.ask({"type": "join", "episode": code}, "joined")
    return code


def test_it_learns_the_kitchen_while_all_are_there(tmp_path: Path) -> None:
    async def main() -> None:
        thread = ThreadBotWorker(ImmediateExecutor())
        async with (
            serving(tmp_path, bot_worker=lambda: thread) as server,
            raw(server) as ada,
            raw(server) as bob,
        ):
            code = await begin(server, ada, bob, task="multi_agent/03")
            room = server.lobby.find(code)
            digest = room.world.task.digest
            while not thread.bots.knows(digest):
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.1)
            assert thread.bots._worlds[digest].learnt == {"robot1", "robot2"}
            assert all(seat.present for seat in room.episode.seats.values())

    run(main())


@pytest.mark.parametrize(
    "task", ["multi_agent/01", pytest.param("multi_agent/10", marks=pytest.mark.slow)]
)
def test_it_acts_in_the_next_step_of_real_time(task: str, tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as bob:
            async with raw(server, name="ada") as ada:
                code = await begin(server, ada, bob, task=task, clock="realtime", step_rate=5)
                room = server.lobby.find(code)
                while room.episode.step < 3:
                    await asyncio.sleep(0.1)
            while room.episode.seats["robot1"].tally.substituted < 3:
                await asyncio.sleep(0.1)
            room.abort("seen")

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    (left,) = [n["step"] for n in recording.notes() if n.get("controller") == "stand-in"]
    moved = [f["step"] for f in recording.steps if any(m["player"] == "robot1" for m in f["moves"])]
    assert moved[0] == left + 1
