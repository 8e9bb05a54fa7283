"""Going round all of some things again and again, beside the games."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Set
from typing import Generic, TypeVar

__all__ = ["Rounds"]

R = TypeVar("R")


class Rounds(Generic[R]):
    """Looks at all that are `live`, again and again while there are any.

    Args:
        seconds: From the end of a round to the next one.
        look: Looks at one. If it says that it had something to do, the next is looked at
            in another turn of the event loop.
    """

    def __init__(self, live: Set[R], seconds: float, look: Callable[[R], bool]) -> None:
        self._live = live
        self._seconds = seconds
        self._look = look
        self._timer: asyncio.Handle | None = None

    def begin(self) -> None:
        """There is one to look after."""
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(self._seconds, self._go_round)

    def stop(self) -> None:
        """Look no more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _go_round(self) -> None:
        self._timer = None
        if self._live:
            self._go_on(iter(list(self._live)))

    def _go_on(self, rooms: Iterator[R]) -> None:
        for room in rooms:
            # Since the round began an episode may have ended, and its file be a thread's.
            if room in self._live and self._look(room):
                self._timer = asyncio.get_running_loop().call_soon(self._go_on, rooms)
                return
        self._timer = None
        self.begin()
