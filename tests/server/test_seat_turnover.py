"""Who comes and goes without end fills no recording, and ends no game by that."""

from __future__ import annotations

import asyncio
from pathlib import Path

from robotouille_server.rooms.seats.seat_turnover import SEAT_CHANGES, SEAT_CHANGES_AT_ONCE
from tests.support.servers import raw, serving
from tests.support.virtual_time import run

HELLO = {"type": "hello", "protocol": 1, "name": "eve"}


def test_a_seat_changes_hands_so_often(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada:
            created = await ada.ask({"type": "create", "task": "multi_agent/01"}, "created")
            join = {"type": "join", "episode": created["code"].lower().replace("-", " ")}
            await ada.ask({**join, "seat": "robot1"}, "joined")
            room = server.lobby.find(created["code"])
            taken = 0
            for _ in range(10):  # A new connection has a budget of its own.
                async with raw(server) as eve:
                    for _ in range(12):
                        answer = await eve.ask(join, "joined")
                        if answer["type"] == "error":
                            assert answer["code"] == "rate/seats"
                            break
                        taken += 1
                        await eve.ask({"type": "leave"}, "left")
            assert taken <= SEAT_CHANGES_AT_ONCE + SEAT_CHANGES
            assert room.journal is not None
            assert room.journal.size < 100_000
            await asyncio.sleep(10)
            async with raw(server) as bob:
                assert (await bob.ask(join, "joined"))["seat"] == "robot2"

    run(main())


def test_who_flaps_has_to_wait_and_keeps_the_seat(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, grace=300) as server, raw(server) as ada:
            created = await ada.ask({"type": "create", "task": "multi_agent/01"}, "created")
            join = {"type": "join", "episode": created["code"], "seat": "robot1"}
            joined = await ada.ask(join, "joined")
            resume, refused = joined["resume"], None
            for _ in range(SEAT_CHANGES_AT_ONCE + SEAT_CHANGES):
                async with raw(server, hello=False) as again:
                    answer = await again.ask({**HELLO, "resume": resume}, "welcome", "bye")
                    if answer["type"] == "bye":
                        refused = answer
                        break
                    resume = (await again.expect("joined"))["resume"]
            assert refused is not None
            assert (refused["code"], refused["retry"]) == ("rate/seats", True)
            assert "lost and regained its connection too often" in refused["reason"]
            await asyncio.sleep(5)
            async with raw(server, hello=False) as again:
                assert (await again.ask({**HELLO, "resume": resume}, "welcome"))["resumed"] is True
                assert (await again.expect("joined"))["seat"] == "robot1"

    run(main())


def test_a_person_is_given_a_seat_that_is_in_nobodys_way(tmp_path: Path) -> None:
    """The first seat stands at the only sink. A bot is given it; so is who asks for it, and the
    first who comes to a study."""

    async def main() -> None:
        async with serving(tmp_path) as server:

            async def seat_of(
                kind: str, *, seat: str | None = None, ready: bool = False, **labels: str
            ) -> str:
                async with raw(server, hello=False) as one:
                    await one.ask({**HELLO, "kind": kind}, "welcome")
                    create = {"type": "create", "task": "multi_agent/07", "seats": 4}
                    created = await one.ask({**create, "labels": labels}, "created")
                    join = {"type": "join", "episode": created["code"], "seat": seat}
                    return (await one.ask({**join, "ready": ready}, "joined"))["seat"]

            assert await seat_of("human") == "robot2"
            assert await seat_of("human", ready=True) == "robot1"
            assert await seat_of("bot") == "robot1"
            assert await seat_of("human", seat="robot1") == "robot1"
            assert await seat_of("human", study="pilot") == "robot1"

    run(main())
