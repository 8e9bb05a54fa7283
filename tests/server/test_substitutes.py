"""Substitutes of absent participants."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from robotouille.domain.loading import load_task
from robotouille.replay.recording import read_recording
from robotouille.world.world import shared_world
from robotouille_server import Server
from robotouille_server.rooms.substitutes.bot_worker import ThreadBotWorker
from tests.support.executors import ImmediateExecutor
from tests.support.questions import question
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import virtual


async def begin(server: Server, ada: Raw, bob: Raw, **options: Any) -> str:
    """Let both participants join a new episode; return its code."""
    request = {"type": "create", "absence": "bot", "substitute": "planner", **options}
    code: str = (await ada.ask(request, "created"))["code"]
    for one in (ada, bob):
        await one.ask({"type": "join", "episode": code}, "joined")
    return code


@pytest.mark.slow
@virtual
async def test_substitute_is_prepared_while_all_are_present(tmp_path: Path) -> None:
    thread = ThreadBotWorker(ImmediateExecutor())
    async with (
        serving(tmp_path, bot_worker=lambda: thread) as server,
        raw(server) as ada,
        raw(server) as bob,
    ):
        code = await begin(server, ada, bob, task="training/03_multi_agent@2")
        room = server.lobby.find(code)
        digest = room.world.task.digest
        while not thread.bots.knows(digest):
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.1)
        assert thread.bots._worlds[digest].learnt == {"robot1", "robot2"}
        assert all(seat.present for seat in room.episode.seats.values())


@pytest.mark.slow
@pytest.mark.parametrize(
    "task", ["training/03_multi_agent@2", pytest.param("multi_agent/10", marks=pytest.mark.nightly)]
)
@virtual
async def test_substitute_acts_in_the_next_real_time_step(task: str, tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as bob:
        async with raw(server, name="ada") as ada:
            code = await begin(server, ada, bob, task=task, clock="realtime", step_rate=5)
            room = server.lobby.find(code)
            while room.episode.step < 3:
                await asyncio.sleep(0.1)
        while room.episode.seats["robot1"].tally.substituted < 3:
            await asyncio.sleep(0.1)
        room.abort("seen")
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    (left,) = [n["step"] for n in recording.notes() if n.get("controller") == "substitute"]
    moved = [f["step"] for f in recording.steps if any(m["player"] == "robot1" for m in f["moves"])]
    assert moved[0] == left + 1


@virtual
async def test_substitute_decides_again_after_a_short_return(tmp_path: Path) -> None:
    """Its decision is dropped when the participant is back."""
    async with serving(tmp_path) as server, raw(server, name="ada") as ada:
        request = {"type": "create", "task": "multi_agent/02", "clock": "lockstep",
                   "absence": "bot", "substitute": "random"}  # fmt: skip
        created = await ada.ask(request, "created")
        join = {"type": "join", "episode": created["code"]}
        await ada.ask(join, "joined")
        episode = server.lobby.find(created["code"]).episode
        seat = episode.seat("robot2")
        async with raw(server, name="bob") as bob:
            joined = await bob.ask(join, "joined")
            assert joined["seat"] == "robot2"
        async with asyncio.timeout(600):
            while seat.pending is None:
                await asyncio.sleep(0.05)
        async with raw(server, hello=False) as bob:
            hello = {"type": "hello", "protocol": 1, "name": "bob"}
            await bob.ask({**hello, "resume": joined["resume"]}, "welcome")
            await bob.expect("joined")
            assert seat.pending is None
        await ada.send({"type": "act", "seq": 1, "action": None})
        async with asyncio.timeout(600):
            while episode.step == 0:
                await asyncio.sleep(0.05)
        assert (await ada.expect("delta"))["step"] == 1


TASK = load_task("training/03_multi_agent@2")
START = shared_world(TASK).initial


@virtual
async def test_closed_thread_ends_and_retired_thread_answers_first() -> None:
    worker = ThreadBotWorker()
    answer = worker.ask(TASK, question(START, kind="random"))
    worker.retire()
    assert await answer is not None
    with pytest.raises(RuntimeError):
        worker.ask(TASK, question(START, kind="random"))
    await worker.close()
