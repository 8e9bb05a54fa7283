"""Long work on the event loop, which is done in turns with other work."""

from __future__ import annotations

import asyncio
from collections.abc import Generator
from typing import TypeVar

FRAMES_A_TURN = 10
"""Frames read in one turn of the event loop. They take a millisecond or two."""

T = TypeVar("T")


async def in_turns(work: Generator[object, None, T]) -> T:
    """Do some work, and let others run after every `FRAMES_A_TURN` parts; return its result.

    Args:
        work: Yields after each part, such as a frame of a recording.
    """
    while True:
        try:
            for _ in range(FRAMES_A_TURN):
                next(work)
        except StopIteration as end:
            found: T = end.value
            return found
        await asyncio.sleep(0)
