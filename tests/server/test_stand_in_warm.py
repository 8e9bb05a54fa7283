"""A stand-in is ready before it is needed, and acts in the next step also where time runs."""

from __future__ import annotations

import asyncio
from concurrent.futures import Executor, Future
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from robotouille.domain.catalogue import load_task
from robotouille.episode import Episode, Rules
from robotouille.planning.anytime import Anytime
from robotouille.replay.recording import read_recording
from robotouille.world.world import shared_world
from robotouille_server import Server, stand_in
from robotouille_server.stand_in import EXPANSIONS, StandIn, _Kitchen, _kitchens
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import run


async def begin(server: Server, ada: Raw, bob: Raw, **options: Any) -> str:
    """Both have joined a new game; its code."""
    request = {"type": "create", "absence": "bot", "stand_in": "planner", **options}
    code: str = (await ada.ask(request, "created"))["code"]
    for one in (ada, bob):
        await one.ask({"type": "join", "episode": code}, "joined")
    return code


async def known(kitchen: _Kitchen) -> None:
    """The kitchen has been learnt."""
    async with asyncio.timeout(60):
        while kitchen._anytime is None or kitchen.thinking.locked():
            await asyncio.sleep(0.01)


def test_it_learns_the_kitchen_while_all_are_there(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada, raw(server) as bob:
            code = await begin(server, ada, bob, task="multi_agent/03")
            kitchen = _kitchens[server.lobby.find(code).world.task.digest]
            await known(kitchen)
            assert all(seat.present for seat in server.lobby.find(code).episode.seats.values())

    asyncio.run(main())


class AtOnce(Executor):
    """Thinks while time stands still."""

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> Future[Any]:
        thought: Future[Any] = Future()
        thought.set_result(function(*arguments, **options))
        return thought


@pytest.mark.parametrize("task", ["multi_agent/01", "multi_agent/10"])
def test_it_acts_in_the_next_step_of_real_time(
    task: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stand_in, "_threads", AtOnce)

    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as bob:
            async with raw(server, name="ada") as ada:
                code = await begin(server, ada, bob, task=task, clock="realtime", step_rate=5)
                room = server.lobby.find(code)
                while room.episode.step < 3:
                    await asyncio.sleep(0.1)
            while not room.episode.seats["robot1"].tally.applied:
                await asyncio.sleep(0.1)
            room.abort("seen")

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    (left,) = [n["step"] for n in recording.notes() if n.get("controller") == "stand-in"]
    moved = [f["step"] for f in recording.steps if any(m["player"] == "robot1" for m in f["moves"])]
    assert moved[0] == left + 1


async def minds(number: int) -> list[StandIn]:
    world = shared_world(load_task("multi_agent/05"))
    episodes = [Episode(world, Rules()) for _ in range(number)]
    return [StandIn(e, "robot1", "planner", lambda *_: None) for e in episodes]


def test_all_games_of_a_task_learn_its_kitchen_once(monkeypatch: pytest.MonkeyPatch) -> None:
    learnt: list[dict[str, Any]] = []
    answers = Anytime.answers

    def counted(self: Anytime, *arguments: Any, **options: Any) -> Any:
        learnt.append(options)
        return answers(self, *arguments, **options)

    async def main() -> None:
        stand_ins = await minds(20)
        for one in stand_ins:
            one.warm()
        async with asyncio.timeout(60):
            for one in stand_ins:
                assert one._mind is not None
                await asyncio.to_thread(one._mind.wake)

    monkeypatch.setattr(Anytime, "answers", counted)
    asyncio.run(main())
    assert [options["beam"] for options in learnt] == [EXPANSIONS]


def test_what_was_found_out_is_forgotten_when_many_have_planned(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def main() -> None:
        monkeypatch.setattr(stand_in, "MOST_MINDS", 3)
        monkeypatch.setattr(stand_in, "_threads", AtOnce)
        planners = []
        for one in await minds(7):
            one.warm()
            mind = one._mind
            assert mind is not None
            state = one._episode.state
            mind.think(state.facts, (), (), [])
            planners.append(mind._kitchen._anytime)
        assert [a is b for a, b in pairwise(planners)] == [True, True, False, True, True, False]

    asyncio.run(main())
