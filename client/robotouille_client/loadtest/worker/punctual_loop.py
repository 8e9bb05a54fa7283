"""An event loop whose timers are punctual.

With epoll an event loop sleeps for whole milliseconds, so its timers are half a millisecond late
on average: several times what a message takes through the loopback interface.
"""

from __future__ import annotations

import asyncio
import select
import selectors

__all__ = ["precise_loop"]

LIMIT = 1024
"""`select` takes descriptors below this number only."""


def precise_loop() -> asyncio.AbstractEventLoop:
    """A new event loop, with timers exact to some microseconds where the system allows it."""
    if not hasattr(selectors, "EpollSelector"):
        return asyncio.new_event_loop()
    selector = _PreciseSelector()
    if selector.fileno() >= LIMIT:
        selector.close()
        return asyncio.new_event_loop()
    return asyncio.SelectorEventLoop(selector)


if hasattr(selectors, "EpollSelector"):

    class _PreciseSelector(selectors.EpollSelector):
        """Waits for the epoll descriptor itself with `select`, which knows microseconds."""

        def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
            if timeout is None or timeout <= 0:
                return super().select(timeout)
            select.select((self.fileno(),), (), (), timeout)
            return super().select(0)
