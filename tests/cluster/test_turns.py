"""Order in which a node reads and replays journals."""

from __future__ import annotations

import asyncio

from robotouille_server.cluster.episodes.turns import AT_A_TIME, LONG_AT_A_TIME, Turns
from tests.support.virtual_time import virtual


@virtual
async def test_a_place_is_left_to_short_journals() -> None:
    turns, long_ones = Turns(), 0

    async def replay(size: int) -> None:
        nonlocal long_ones
        async with turns.long(size):
            long_ones += 1
            await asyncio.sleep(60)

    tasks = [asyncio.create_task(replay(size)) for size in range(5)]
    await asyncio.sleep(1)
    async with asyncio.timeout(1), turns.first():
        assert long_ones == LONG_AT_A_TIME < AT_A_TIME
    await asyncio.gather(*tasks)


@virtual
async def test_cancelled_turns_leave_their_places() -> None:
    turns, order = Turns(), list[int]()

    async def replay(size: int) -> None:
        async with turns.long(size):
            order.append(size)
            await asyncio.sleep(60)

    tasks = [asyncio.create_task(replay(size)) for size in range(5)]
    await asyncio.sleep(1)
    for task in tasks[:-1]:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    assert order == [0, 1, 4]
