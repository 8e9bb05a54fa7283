"""For how long a silent participant can hold the others: what is said, and if nothing is said."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from tests.support.servers import crash, raw, serving
from tests.support.virtual_time import run

TWO, ONE = "multi_agent/01", "synchronous/01"


@pytest.mark.parametrize(
    ("settings", "create", "budget"),
    [
        ({}, {"task": TWO}, 300.0),
        ({}, {"task": TWO, "clock": "turn"}, 300.0),
        ({}, {"task": TWO, "clock": "realtime", "thinking": "declared"}, 300.0),
        ({}, {"task": TWO, "clock": "realtime"}, None),
        ({}, {"task": ONE}, None),
        ({}, {"task": TWO, "move_budget": 0}, None),
        ({}, {"task": TWO, "move_budget": 7.5}, 7.5),
        ({}, {"task": ONE, "move_budget": 7.5}, 7.5),
        ({"move_budget": "0"}, {"task": TWO}, None),
        ({"move_budget": "60"}, {"task": TWO}, 60.0),
        ({"move_budget": "60"}, {"task": ONE}, 60.0),
        ({"move_budget": "60"}, {"task": TWO, "move_budget": 0}, None),
        ({"move_budget": "0"}, {"task": TWO, "move_budget": 5.0}, 5.0),
    ],
)
def test_the_budget_of_an_episode(
    tmp_path: Path, settings: dict[str, str], create: dict[str, Any], budget: float | None
) -> None:
    async def main() -> None:
        async with serving(tmp_path, **settings) as server, raw(server) as ada:
            created = await ada.ask({"type": "create", **create}, "created")
            assert server.lobby.find(created["code"]).episode.rules.move_budget == budget
            await ada.send({"type": "join", "episode": created["code"], "role": "spectator"})
            assert (await ada.expect("snapshot"))["clock"]["move_budget"] == budget

    run(main())


@pytest.mark.parametrize("clock", ["turn", "lockstep"])
def test_somebody_silent_holds_the_others_for_five_minutes_and_no_longer(
    tmp_path: Path, clock: str
) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            raw(server, name="ada") as ada,
            raw(server, name="bob") as bob,
        ):
            created = await ada.ask({"type": "create", "task": TWO, "clock": clock}, "created")
            await ada.ask({"type": "join", "episode": created["code"]}, "joined")
            await bob.ask({"type": "join", "episode": created["code"]}, "joined")
            room = server.lobby.find(created["code"])
            if clock == "lockstep":
                await bob.send({"type": "act", "seq": 1, "action": None})
            await asyncio.sleep(299.0)
            assert room.episode.step == 0
            await asyncio.sleep(2.0)
            assert room.episode.step == 1

    run(main())


def test_a_restart_keeps_no_limit(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada, raw(server) as bob:
            request = {"type": "create", "task": TWO, "move_budget": 0}
            created = await ada.ask(request, "created")
            await ada.ask({"type": "join", "episode": created["code"]}, "joined")
            await bob.ask({"type": "join", "episode": created["code"]}, "joined")
            await crash(server)
        async with serving(tmp_path, seed=2) as server:
            assert server.lobby.find(created["code"]).episode.rules.move_budget is None

    run(main())
