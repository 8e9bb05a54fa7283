"""A stand-in that is called again and again decides each time."""

from __future__ import annotations

import asyncio
from pathlib import Path

from tests.support.servers import raw, serving
from tests.support.virtual_time import run


def test_a_stand_in_decides_again_after_a_short_return(tmp_path: Path) -> None:
    """Its decision is dropped when its person is back; when they go again it takes another."""

    async def main() -> None:
        async with serving(tmp_path) as server, raw(server, name="ada") as ada:
            request = {"type": "create", "task": "multi_agent/02", "clock": "lockstep",
                       "absence": "bot", "stand_in": "random"}  # fmt: skip
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

    run(main())
