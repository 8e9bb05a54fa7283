"""When rooms want to be called, and what time it is for them.

One timer of the event loop serves the timers of all rooms. The event loop compares its own
timers in Python, a dozen times for each of a thousand rooms' steps; here plain tuples are compared.

The rooms' time is the event loop's without what the process has stood still (SIGSTOP, a suspended
machine, a blocked loop): nobody could come back then, and no step was taken.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from heapq import heapify, heappop, heappush
from itertools import count

from robotouille_server.runtime.logs import get_logger

__all__ = ["BEAT", "LATE", "TimerHandle", "TimerQueue"]

AT_ONCE = 50
"""Calls after which what has come from the network has its turn."""
TIDY_FROM = 100
"""Cancelled timers from which on the heap is looked through, if they are half of it."""
BEAT = 2.0
"""Seconds after which the clock is looked at, at the latest, while there are timers."""
LATE = 3.0
"""Seconds by which that is late at least when the process has stood still."""


class TimerHandle:
    """A call that is due; it is called with the time at which it was due."""

    __slots__ = ("call", "due")

    def __init__(self, due: float, call: Callable[[float], None]) -> None:
        self.due = due
        self.call: Callable[[float], None] | None = call


class TimerQueue:
    """Calls at given times of its own clock, each at most once. `lost` are the seconds for which
    the process has stood still so far."""

    def __init__(self) -> None:
        self.lost = 0.0
        self._loop = asyncio.get_running_loop()
        self._loop_time = self._loop.time
        self._seen = self._loop_time()
        self._heap: list[tuple[float, int, TimerHandle]] = []
        self._numbers = count()
        self._cancelled = 0
        self._timer: asyncio.TimerHandle | None = None
        self._timer_at = 0.0
        self._running = self._watching = False

    def time(self) -> float:
        """What time it is for the rooms."""
        now = self._loop_time()
        if now - self._seen > BEAT + LATE and self._watching:
            self._stood_still(now - self._seen)
        self._seen = now
        return now - self.lost

    def _stood_still(self, seconds: float) -> None:
        self.lost += seconds
        get_logger().warning("the server stood still", seconds=round(seconds, 1))

    def call_at(self, due: float, call: Callable[[float], None]) -> TimerHandle:
        """Call `call(due)` at the time `due`, or soon if that has passed."""
        handle = TimerHandle(due, call)
        heappush(self._heap, (due, next(self._numbers), handle))
        if not self._running and (self._timer is None or due + self.lost < self._timer_at):
            self._arm()
        return handle

    def cancel(self, handle: TimerHandle) -> None:
        if handle.call is None:
            return
        handle.call = None
        self._cancelled += 1
        if self._cancelled > TIDY_FROM and self._cancelled > len(self._heap) // 2:
            self._heap = [entry for entry in self._heap if entry[2].call is not None]
            heapify(self._heap)
            self._cancelled = 0

    def clear(self) -> None:
        """Cancel everything."""
        self._heap.clear()
        self._cancelled = 0
        self._arm()

    def _arm(self) -> None:
        """Wait for the next handle, or the next look at the clock."""
        now = self.time()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._watching = bool(self._heap)
        if self._watching:
            due = min(self._heap[0][0], now + BEAT)
            self._timer_at = due + self.lost
            self._timer = self._loop.call_at(self._timer_at, self._run)

    def _run(self) -> None:
        self._timer = None
        self._running = True
        self.time()
        try:
            for _ in range(AT_ONCE):
                # The very sum for which the timer was set: differences round otherwise.
                if not self._heap or self._heap[0][0] + self.lost > self._seen:
                    return
                due, _number, handle = heappop(self._heap)
                call, handle.call = handle.call, None
                if call is None:
                    self._cancelled -= 1
                else:
                    call(due)
        finally:
            self._running = False
            self._arm()
