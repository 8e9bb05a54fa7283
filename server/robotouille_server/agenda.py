"""When rooms want to be called: one timer of the event loop for all of them.

The event loop compares its own timers in Python, a dozen times for each of a thousand rooms'
steps; here plain tuples are compared.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from heapq import heapify, heappop, heappush
from itertools import count

__all__ = ["Agenda", "Appointment"]

AT_ONCE = 50
"""Calls after which what has come from the network has its turn."""
TIDY_FROM = 100
"""Cancelled appointments from which on the heap is looked through, if they are half of it."""


class Appointment:
    """A call that is due; it is called with the time at which it was due."""

    __slots__ = ("call", "due")

    def __init__(self, due: float, call: Callable[[float], None]) -> None:
        self.due = due
        self.call: Callable[[float], None] | None = call


class Agenda:
    """Calls at given times of the running event loop, each at most once."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._heap: list[tuple[float, int, Appointment]] = []
        self._numbers = count()
        self._cancelled = 0
        self._timer: asyncio.TimerHandle | None = None
        self._running = False

    def call_at(self, due: float, call: Callable[[float], None]) -> Appointment:
        """Call `call(due)` at the time `due`, or soon if that has passed."""
        appointment = Appointment(due, call)
        heappush(self._heap, (due, next(self._numbers), appointment))
        if not self._running and (self._timer is None or due < self._timer.when()):
            self._arm()
        return appointment

    def cancel(self, appointment: Appointment) -> None:
        if appointment.call is None:
            return
        appointment.call = None
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
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._heap:
            self._loop = self._loop or asyncio.get_running_loop()
            self._timer = self._loop.call_at(self._heap[0][0], self._run)

    def _run(self) -> None:
        self._timer = None
        self._running = True
        now = asyncio.get_running_loop().time()
        try:
            for _ in range(AT_ONCE):
                if not self._heap or self._heap[0][0] > now:
                    return
                due, _number, appointment = heappop(self._heap)
                call, appointment.call = appointment.call, None
                if call is None:
                    self._cancelled -= 1
                else:
                    call(due)
        finally:
            self._running = False
            self._arm()
