"""When Python's collector of garbage looks through everything: rarely, as all games wait meanwhile.

Play leaves next to no garbage in circles; what closes leaves some: connections, their tasks, rooms.
Left to itself the collector would look at a thousand rooms again and again, and find nothing.
"""

from __future__ import annotations

import asyncio
import gc
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


@asynccontextmanager
async def rare_collections(
    there: Callable[[], int], closed: Callable[[], int]
) -> AsyncIterator[None]:
    """Meanwhile, garbage among old objects is collected once half as much was closed as is there.

    `there` says how many connections and rooms there are, `closed` how many have ever been closed.
    """
    looking = asyncio.create_task(_look(there, closed))
    try:
        yield
    finally:
        looking.cancel()
        await asyncio.wait({looking})


async def _look(there: Callable[[], int], closed: Callable[[], int]) -> None:
    usual = gc.get_threshold()
    gc.set_threshold(NEW, MANY, NEVER)
    try:
        gc.collect()
        before = closed()
        while True:
            await asyncio.sleep(LOOK_SECONDS)
            if closed() - before >= max(CLOSED_AT_LEAST, there() // 2):
                gc.collect()
                before = closed()
    finally:
        gc.set_threshold(*usual)
