"""Turns of journals that a node reads and replays: long ones do not keep short ones waiting."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from heapq import heappop, heappush
from itertools import count

AT_A_TIME = 3
"""Journals at a time. With more, all come back late, because they share a processor."""
LONG_AT_A_TIME = 2
"""Long journals at a time, so that one place is left to short ones."""
SHORT_JOURNAL = 256 * 1024
"""Bytes of a journal that is replayed as soon as it is read. This takes half a second or less."""


class JournalTurns:
    """Turns of a node's journals.

    A journal's length is known once it is read. A long one is then forgotten, so that those that
    wait fill no memory, and read again in a turn for long ones. The shortest has the next turn.
    Players can make recordings of a million steps, and other games would wait minutes for them.
    """

    def __init__(self) -> None:
        self._places = asyncio.Semaphore(AT_A_TIME)
        self._unread = 0
        self._free = LONG_AT_A_TIME
        self._waiting: list[tuple[int, int, asyncio.Future[None]]] = []
        self._arrivals = count()

    @asynccontextmanager
    async def reading(self) -> AsyncIterator[None]:
        """Return a context for reading a journal, and for replaying it if it is short."""
        self._unread += 1
        try:
            async with self._places:
                yield
        finally:
            self._unread -= 1
            # If this journal is long, it waits for its turn when the call comes.
            asyncio.get_running_loop().call_soon(self._give_turns)

    @asynccontextmanager
    async def replaying_long(self, size: int) -> AsyncIterator[None]:
        """Return a context for reading a long journal again and replaying it.

        Args:
            size: The bytes of the journal.
        """
        turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        heappush(self._waiting, (size, next(self._arrivals), turn))
        self._give_turns()
        try:
            await turn
            async with self._places:
                yield
        finally:
            self._free += not turn.cancelled()
            self._give_turns()

    def _give_turns(self) -> None:
        """Let the shortest journals begin, once the lengths of all are known."""
        while self._free and self._waiting and not self._unread:
            *_, turn = heappop(self._waiting)
            if not turn.done():
                turn.set_result(None)
                self._free -= 1
