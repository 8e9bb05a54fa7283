"""Timers and time of all rooms.

One timer of the event loop serves the timers of all rooms. The event loop compares its timer
objects in Python, about a dozen times per step and room. Here, tuples are compared, in C.

The time of the rooms excludes time in which the process was suspended (SIGSTOP, a suspended
machine, a blocked loop). Players could not come back then, so their grace must not run out.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Set
from heapq import heapify, heappop, heappush
from itertools import count
from typing import Generic, TypeVar

from robotouille_server.runtime.logs import get_logger

R = TypeVar("R")


class Rounds(Generic[R]):
    """Calls a function for all live rooms, in rounds.

    Args:
        live: The live rooms.
        seconds: The seconds between the end of a round and the start of the next one.
        check: Is called with a room. If it returns True because it had work to do, the round
            continues in another turn of the event loop.
    """

    def __init__(self, live: Set[R], seconds: float, check: Callable[[R], bool]) -> None:
        self._live = live
        self._seconds = seconds
        self._check = check
        self._timer: asyncio.Handle | None = None

    def begin(self) -> None:
        """Start rounds, because there is a live room."""
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(self._seconds, self._go_round)

    def stop(self) -> None:
        """Stop."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _go_round(self) -> None:
        self._timer = None
        if self._live:
            self._go_on(iter(list(self._live)))

    def _go_on(self, rooms: Iterator[R]) -> None:
        for room in rooms:
            # An episode may have ended since the round began; its file then belongs to a thread.
            if room in self._live and self._check(room):
                self._timer = asyncio.get_running_loop().call_soon(self._go_on, rooms)
                return
        self._timer = None
        self.begin()


AT_ONCE, RUN_SECONDS = 50, 0.02
"""Calls in a row, and their seconds, before data from the network is processed."""
GRAIN = 0.001
"""Seconds before its time that a timer may be called together with an earlier one. Waking up for
each room takes as long as the step itself."""
TIDY_FROM = 100
"""Cancelled timers above which the heap is cleaned up, if they are half of it."""
BEAT = 2.0
"""Maximum seconds between two readings of the clock while there are timers."""
LATE = 3.0
"""Delay of such a reading above which the process counts as suspended."""


class TimerHandle:
    """Timer that calls a function with the time at which it was due."""

    __slots__ = ("call", "due")

    def __init__(self, due: float, call: Callable[[float], None]) -> None:
        self.due = due
        self.call: Callable[[float], None] | None = call


class TimerQueue:
    """Timers on a clock of their own.

    Attributes:
        lost: The seconds for which the process has been suspended.
    """

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
        """Return the time of the rooms."""
        now = self._loop_time()
        # While timers exist, the clock is read every `BEAT` seconds, so a longer gap means that the
        # process did not run.
        if now - self._seen > BEAT + LATE and self._watching:
            self._was_suspended(now - self._seen)
        self._seen = now
        return now - self.lost

    def _was_suspended(self, seconds: float) -> None:
        self.lost += seconds
        get_logger().warning("the server was suspended", seconds=round(seconds, 1))

    def call_at(self, due: float, call: Callable[[float], None]) -> TimerHandle:
        """Call `call(due)` at `due`, up to `GRAIN` earlier, or soon if that time has passed."""
        handle = TimerHandle(due, call)
        # The number keeps the order of equal times and stops the comparison before the handle.
        heappush(self._heap, (due, next(self._numbers), handle))
        if not self._running and (self._timer is None or due + self.lost < self._timer_at):
            self._arm()
        return handle

    def cancel(self, handle: TimerHandle) -> None:
        if handle.call is None:
            return
        handle.call = None
        self._cancelled += 1
        # Removing an entry from the middle of a heap takes linear time, so many are removed at
        # once.
        if self._cancelled > TIDY_FROM and self._cancelled > len(self._heap) // 2:
            self._heap = [entry for entry in self._heap if entry[2].call is not None]
            heapify(self._heap)
            self._cancelled = 0

    def clear(self) -> None:
        """Cancel all timers."""
        self._heap.clear()
        self._cancelled = 0
        self._arm()

    def _arm(self) -> None:
        """Set the event loop's timer to the next timer or reading of the clock."""
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
        # Timers read the clock. The limits are those of the run's start, so that a timer cannot
        # keep the run going by setting another one for the present.
        now, last = self.time() + GRAIN, next(self._numbers)
        until = self._seen + RUN_SECONDS
        try:
            for _ in range(AT_ONCE):
                if not self._heap or self._heap[0][0] > now or self._heap[0][1] > last:
                    return
                due, _number, handle = heappop(self._heap)
                call, handle.call = handle.call, None
                if call is None:
                    self._cancelled -= 1
                else:
                    call(due)
                    if self._loop_time() >= until:
                        return
        finally:
            self._running = False
            self._arm()
