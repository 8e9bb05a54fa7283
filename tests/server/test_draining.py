"""A server that is about to be restarted leaves its episodes to the next one."""

from __future__ import annotations

import asyncio
import fcntl
from pathlib import Path

from tests.support.servers import raw, serving
from tests.support.virtual_time import run


def test_a_draining_server_takes_nothing_back(tmp_path: Path) -> None:
    """It has looked out for a recording that another process holds, and looks no more."""

    async def main() -> None:
        foreign = tmp_path / "20260101T000000Z_x_00000000000000aa.rbt.part"
        foreign.write_bytes(b"RBTL\x01")
        with foreign.open("ab") as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            async with serving(tmp_path) as old, raw(old) as ada:
                created = await ada.ask({"type": "create", "task": "multi_agent/02"}, "created")
                await ada.ask({"type": "join", "episode": created["code"]}, "joined")
                assert created["episode"] in old.lobby.rooms
                draining = asyncio.create_task(old.drain(20))
                await asyncio.sleep(3)
                assert not old.lobby.rooms
                async with serving(tmp_path, seed=2) as new:
                    assert list(new.lobby.rooms) == [created["episode"]]
                await draining

    run(main())
