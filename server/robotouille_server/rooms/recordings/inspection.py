"""Looks after open recordings: whether somebody has removed or cut a file that is written."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Set

from robotouille_server.rooms.recordings.journal import RecordedRoom

__all__ = ["LOOK_SECONDS", "Inspection"]

LOOK_SECONDS = 5.0
"""From the end of a round to the next one."""


class Inspection:
    """Goes round the journals of all `live` rooms while there are any. A file that has to be
    written anew takes a turn of the event loop for itself."""

    def __init__(self, live: Set[RecordedRoom]) -> None:
        self._live = live
        self._timer: asyncio.Handle | None = None

    def begin(self) -> None:
        """There is a journal to look after."""
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(LOOK_SECONDS, self._go_round)

    def stop(self) -> None:
        """Look no more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _go_round(self) -> None:
        self._timer = None
        rooms = [room for room in self._live if room.journal is not None]
        if rooms:
            self._go_on(iter(rooms))

    def _go_on(self, rooms: Iterator[RecordedRoom]) -> None:
        for room in rooms:
            # Since the round began an episode may have ended: its file is a thread's by now.
            if room in self._live and room.journal is not None and room.journal.look():
                self._timer = asyncio.get_running_loop().call_soon(self._go_on, rooms)
                return
        self._timer = None
        self.begin()
