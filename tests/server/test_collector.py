"""Garbage is looked for rarely, but it is."""

from __future__ import annotations

import asyncio
import gc
import weakref
from pathlib import Path

from robotouille_client import connect
from robotouille_server.collector import CLOSED_AT_LEAST, NEW_AT_LEAST, rare_collections
from tests.support.servers import serving
from tests.support.virtual_time import run


class Knot:
    """Something that only the collector can free."""

    def __init__(self) -> None:
        self.itself = self


def tie() -> weakref.ref[Knot]:
    return weakref.ref(Knot())


def test_garbage_waits_until_much_was_closed() -> None:
    async def main() -> None:
        opened, closed = 3 * CLOSED_AT_LEAST, 0
        async with rare_collections(lambda: opened, lambda: closed):
            await asyncio.sleep(0.1)
            assert not gc.isenabled()
            knot = tie()
            closed = opened - 1
            await asyncio.sleep(60)
            assert knot() is not None
            closed = opened
            await asyncio.sleep(2)
            assert knot() is None

    was_enabled = gc.isenabled()
    run(main())
    assert gc.isenabled() == was_enabled


def test_garbage_that_nothing_else_tells_of_is_found_too() -> None:
    async def main() -> None:
        async with rare_collections(lambda: 10, lambda: 0):
            await asyncio.sleep(0.1)
            knots = [tie() for _ in range(NEW_AT_LEAST // 2)]  # Each has its attributes, too.
            await asyncio.sleep(2)
            assert not any(knot() for knot in knots)

    run(main())


def test_the_server_counts_what_comes_and_goes(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            assert (server.open, server.closed) == (0, 0)
            async with connect(server.url, name="ada") as ada:
                created = await ada.create("synchronous/01")
                game = await ada.join(created.code)
                assert server.open == 2
                await ada.leave()
                assert game.ended
            await asyncio.sleep(2000)
            assert (server.open, server.closed) == (0, 2)

    run(main())
