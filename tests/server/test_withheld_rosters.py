"""While a recording cannot be written, rosters tell no more than what is in it: a crash would
belie the rest."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from robotouille_server import Server
from robotouille_server.rooms.room import Room
from tests.support.disks import FullDisk
from tests.support.servers import Raw, crash, raw, serving
from tests.support.virtual_time import run

HELLO = {"type": "hello", "protocol": 1}
ACT = {"type": "act", "seq": 1, "action": None}


@asynccontextmanager
async def playing(
    server: Server, ada: Raw, bob: Raw, **options: Any
) -> AsyncIterator[tuple[Raw, Room, dict[str, Any]]]:
    """Ada and Bob play, Eve watches: her connection, the room, and what she was told of it."""
    request = {"type": "create", "task": "multi_agent/02", "clock": "lockstep", **options}
    created = await ada.ask(request, "created")
    join = {"type": "join", "episode": created["code"]}
    async with raw(server, name="eve") as eve:
        joined = await eve.ask({**join, "role": "spectator"}, "joined")
        for one in (ada, bob):
            assert (await one.ask(join, "joined"))["type"] == "joined"
        await heard(ada)
        yield eve, server.lobby.find(created["code"]), joined


async def heard(one: Raw, seconds: float = 1.5) -> list[dict[str, Any]]:
    """All that comes in so many seconds."""
    got = []
    try:
        async with asyncio.timeout(seconds):
            while True:
                got.append(await one.receive())
    except TimeoutError:
        return got


def shown(messages: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """What the rosters among them say of the phase, and of a reason to stand still."""
    return [
        (one["phase"], one.get("pause", {}).get("reason", ""))
        for one in messages
        if one["type"] == "roster"
    ]


def test_an_end_that_is_not_written_is_told_to_nobody(tmp_path: Path) -> None:
    """Neither as the last step is taken, nor when somebody who watches goes and comes."""

    async def main() -> None:
        disk = FullDisk(tmp_path)
        async with (
            serving(tmp_path, storage=disk) as server,
            raw(server, name="ada") as ada,
            raw(server, name="bob") as bob,
        ):
            async with playing(server, ada, bob, max_steps=1) as (eve, room, joined):
                disk.full = True
                for one in (ada, bob):
                    await one.send(ACT)
                assert shown(await heard(ada)) == [("paused", "storage")]
                assert room.episode.ended
                await eve.socket.close()
                assert await heard(ada) == []
            seen = {"episode": room.id, "step": 0, "said": 0}
            async with raw(server, hello=False) as again:
                hello = {**HELLO, "name": "eve", "resume": joined["resume"], "seen": seen}
                await again.send(hello)
                assert [one["type"] for one in await heard(again)] == ["welcome"]
                assert await heard(ada) == []
                disk.full = False
                kinds = [one["type"] for one in await heard(again)]
                assert kinds[0] == "joined"
                assert "ended" in kinds or "snapshot" in kinds
                told = await heard(ada)
                assert [one["type"] for one in told] == ["delta", "ended", "roster"]
                assert (shown(told), told[-1]["spectators"]) == ([("over", "")], 1)

    run(main())


def test_what_was_told_is_what_goes_on_after_a_crash(tmp_path: Path) -> None:
    async def main() -> None:
        disk = FullDisk(tmp_path)
        async with serving(tmp_path, storage=disk) as server:
            async with raw(server, name="ada") as ada, raw(server, name="bob") as bob:
                async with playing(server, ada, bob, max_steps=1) as (eve, _room, joined):
                    disk.full = True
                    for one in (ada, bob):
                        await one.send(ACT)
                    await eve.ask({"type": "leave"}, "left")
                    told = shown(await heard(ada))
                    await crash(server)
        async with serving(tmp_path, seed=2) as server:
            room = server.lobby.find(joined["code"])
            assert (room.episode.step, room.episode.ended) == (0, False)
        assert told == [("paused", "storage")]

    run(main())


def test_a_seat_that_is_lost_meanwhile_is_told_once_that_is_written(tmp_path: Path) -> None:
    async def main() -> None:
        disk = FullDisk(tmp_path)
        async with serving(tmp_path, storage=disk) as server, raw(server, name="ada") as ada:
            async with raw(server, name="bob") as bob:
                async with playing(server, ada, bob) as (eve, _room, _joined):
                    disk.full = True
                    await bob.socket.close()
                    (roster,) = await heard(ada)
                    assert shown([roster]) == [("paused", "storage")]
                    assert [seat["present"] for seat in roster["seats"]] == [True, True]
                    await eve.ask({"type": "leave"}, "left")
                    assert await heard(ada) == []
                    disk.full = False
                    later = [one for one in await heard(ada) if one["type"] == "roster"]
                    seats = [seat.get("present", False) for seat in later[-1]["seats"]]
                    assert seats == [True, False]
                    assert "spectators" not in later[-1]

    run(main())
