"""When Python's collector of garbage looks through everything: rarely, as all games wait meanwhile.

Play leaves next to no garbage in circles. Left to itself the collector would look at the objects
of a thousand rooms again and again, and find nothing.
"""

from __future__ import annotations

import asyncio
import gc
import os
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

__all__ = ["rare_collections"]

LOOK_SECONDS = 1.0
MARGIN, SHARE = 64 * 2**20, 0.25
"""Bytes, or the share of what was in use, by which the memory may grow until garbage is sought."""
OBJECT_BYTES = 200

STATISTICS = Path("/proc/self/statm")


def memory_in_use() -> int:
    """Bytes of this process in memory; a guess where the system does not tell."""
    try:
        pages = int(STATISTICS.read_bytes().split()[1])
    except OSError:
        return gc.get_count()[0] * OBJECT_BYTES
    return pages * os.sysconf("SC_PAGE_SIZE")


@asynccontextmanager
async def rare_collections(memory: Callable[[], int] = memory_in_use) -> AsyncIterator[None]:
    """Meanwhile, garbage is collected in place of Python: once the `memory` has grown."""
    looking = asyncio.create_task(_look(memory))
    try:
        yield
    finally:
        looking.cancel()
        await asyncio.wait({looking})


async def _look(memory: Callable[[], int]) -> None:
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        most = 0.0
        while True:
            if memory() > most:
                gc.collect()
                left = memory()
                most = left + max(MARGIN, SHARE * left)
            await asyncio.sleep(LOOK_SECONDS)
    finally:
        if was_enabled:
            gc.enable()
