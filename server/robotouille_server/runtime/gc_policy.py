"""When Python's collector of garbage looks through everything: rarely, as all games wait meanwhile.

Play leaves next to no garbage in circles; what closes leaves some: connections, their tasks, rooms.
Left to itself the collector would look at a thousand rooms again and again, and find nothing.
"""

from __future__ import annotations

import asyncio
import gc
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

__all__ = ["rare_collections"]

NEW = 10_000
"""New objects after which Python looks at them, and at them alone: that is quick."""
MANY = 100
"""Such looks after which it looks at all that has come since the last full one."""
NEVER = 1_000_000

LOOK_SECONDS = 1.0
CLOSED_AT_LEAST = 300
"""A TLS connection that goes before its handshake may leave 300 KiB."""
SHARE = 1 / 200
"""Of all time, the most that goes into looks at everything."""


@asynccontextmanager
async def rare_collections(
    live: Callable[[], int], closed: Callable[[], int]
) -> AsyncIterator[None]:
    """Meanwhile, garbage among old objects is collected once half as much was closed as is there.

    `live` says how many connections and rooms there are, `closed` how many have ever been closed.
    What was there before, modules above all, is not looked at any more. Somebody who comes and
    goes without end leaves new objects, and those are looked at by themselves.
    """
    looking = asyncio.create_task(_look(live, closed))
    try:
        yield
    finally:
        looking.cancel()
        await asyncio.wait({looking})


async def _look(live: Callable[[], int], closed: Callable[[], int]) -> None:
    usual, now = gc.get_threshold(), asyncio.get_running_loop().time
    gc.set_threshold(NEW, MANY, NEVER)
    try:
        gc.collect()
        gc.freeze()
        before = young = closed()
        rested = now()
        while True:
            await asyncio.sleep(LOOK_SECONDS)
            if closed() - before >= max(CLOSED_AT_LEAST, live() // 2) and now() >= rested:
                rested = now() + _seconds(gc.collect) / SHARE
                before = young = closed()
            elif closed() - young >= CLOSED_AT_LEAST:
                gc.collect(1)
                young = closed()
    finally:
        gc.unfreeze()
        gc.set_threshold(*usual)


def _seconds(work: Callable[[], object]) -> float:
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun
