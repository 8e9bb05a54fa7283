"""Clients that flood a server are disconnected, and players do not notice."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from tests.programs.simulation.stranger import CODE, FLOODS
from tests.support.fuzzing.wire import Closed, Wire
from tests.support.samples import quick_sample
from tests.support.servers import raw, serving
from tests.support.virtual_time import run

UNANSWERED = ("pings", "pongs", "parts")
"""Floods that the server ends without a message."""


@pytest.mark.parametrize("name", quick_sample(sorted(FLOODS), 4))
def test_flood_is_ended_and_the_episode_continues(tmp_path: Path, name: str) -> None:
    async def main() -> None:
        async with serving(tmp_path, hello_seconds=5) as server, raw(server) as ada:
            order = {"type": "create", "task": "synchronous/01", "clock": "realtime"}
            created = await ada.ask({**order, "step_rate": 10}, "created")
            await ada.ask({"type": "join", "episode": created["code"]}, "joined")
            await ada.expect("snapshot")
            before = (await ada.expect("delta"))["step"]
            wire = await Wire.open(server.port)
            assert await wire.upgrade(text=True) == 101
            said = []
            try:
                await wire.write(FLOODS[name].replace(CODE.encode(), created["code"].encode()))
                async with asyncio.timeout(10):
                    async for answer in wire.messages():
                        said.append(answer)
                pytest.fail("the messages ended without the connection")
            except Closed as closed:
                polite = closed.code == 1008
            assert polite == (name not in UNANSWERED)
            if polite:
                code = "auth/silent" if name == "silence" else "rate/limited"
                assert (said[-1]["type"], said[-1]["code"]) == ("bye", code)
            wire.cut()
            while (await ada.expect("delta"))["step"] < before + 20:
                pass

    run(main())
