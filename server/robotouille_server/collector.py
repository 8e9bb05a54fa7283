"""When Python's collector of garbage looks through everything: rarely, as all games wait meanwhile.

Play leaves no garbage in circles; what closes leaves some: connections, their tasks, rooms. Left
to itself the collector would look at a thousand rooms again and again, and find nothing.
"""

from __future__ import annotations

import asyncio
import gc
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

__all__ = ["rare_collections"]

LOOK_SECONDS = 1.0
CLOSED_AT_LEAST = 1000
NEW_AT_LEAST = 1_000_000
"""New objects after which garbage is looked for although little was closed."""


@asynccontextmanager
async def rare_collections(
    opened: Callable[[], int], closed: Callable[[], int]
) -> AsyncIterator[None]:
    """Meanwhile, garbage is collected in place of Python: once as much has been closed as is open.

    `opened` says how many connections and rooms there are, `closed` how many are gone.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    looking = asyncio.create_task(_look(opened, closed))
    try:
        yield
    finally:
        looking.cancel()
        if was_enabled:
            gc.enable()


async def _look(opened: Callable[[], int], closed: Callable[[], int]) -> None:
    gc.collect()
    before = closed()
    while True:
        await asyncio.sleep(LOOK_SECONDS)
        much_closed = closed() - before >= max(CLOSED_AT_LEAST, opened())
        if much_closed or gc.get_count()[0] >= NEW_AT_LEAST:
            gc.collect()
            before = closed()
