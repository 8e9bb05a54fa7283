"""A bot whose place is not free says that it waits, and its recording says so."""

from __future__ import annotations

import asyncio
from pathlib import Path

from robotouille.planning.policies.planner_policy import PlannerPolicy
from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_client.bots.player import play
from tests.support.servers import serving
from tests.support.virtual_time import run

TASK = "multi_agent/01"


def test_a_planner_beside_somebody_who_stands_in_its_way(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="ada", kind="human") as ada,
            connect(server.url, name="bot") as bot,
        ):
            created = await ada.create(TASK, clock="realtime", step_rate=5.0, max_steps=60)
            one = await ada.join(created.code)
            two = await bot.join(created.code)
            playing = asyncio.create_task(
                play(two, lambda state, seat: PlannerPolicy(state.world, seat), threaded=False)
            )
            board = next(a for a in one.actions if a.name == "move" and "board" in str(a))
            await one.act(board)
            await playing

    run(main())
    recording = read_recording(next(tmp_path.rglob("*.rbt")))
    assert recording.verify().ok
    outcome = recording.outcome
    assert outcome is not None
    person, planner = outcome["seats"]
    assert planner["waiting"] > 10
    assert person["waiting"] == 0
    counted = recording.measures().seats["robot2"]
    assert (counted.waiting, counted.idle) == (planner["waiting"], planner["idle"])
