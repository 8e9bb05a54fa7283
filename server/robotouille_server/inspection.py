"""Looks after open recordings: whether somebody has removed or cut a file that is written."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator

from robotouille_server.journal import Journal

__all__ = ["LOOK_SECONDS", "Inspection"]

LOOK_SECONDS = 5.0
"""From the end of a round to the next one."""


class Inspection:
    """Goes round all `journals` while there are any. A file that has to be written anew takes a
    turn of the event loop for itself."""

    def __init__(self, journals: Callable[[], list[Journal]]) -> None:
        self._journals = journals
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
        journals = self._journals()
        if journals:
            self._go_on(iter(journals))

    def _go_on(self, journals: Iterator[Journal]) -> None:
        for journal in journals:
            if journal.look():
                self._timer = asyncio.get_running_loop().call_soon(self._go_on, journals)
                return
        self._timer = None
        self.begin()
