"""The round trips of participants, for recordings: measured beside the games."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Set
from typing import Protocol

__all__ = ["LOOK_SECONDS", "MeasuredRoom", "RoundTripWatch", "RoundTrips"]

LOOK_SECONDS = 10.0
"""From the end of a round to the next one."""
MIN_CHANGE, MAX_CHANGE = 0.001, 0.02
"""Seconds by which a round trip has to change at least; by which it may, before it is recorded."""


class RoundTrips:
    """The round trips of one episode's seats as they were recorded last."""

    __slots__ = ("_recorded",)

    def __init__(self) -> None:
        self._recorded: dict[str, float] = {}

    def changed(self, player: str, seconds: float) -> bool:
        """Whether one is to be recorded: it is the first, or has changed by more than a quarter or
        20 ms, and at least by 1 ms. Then it is what the next is compared with."""
        before = self._recorded.get(player)
        if before is not None:
            change = abs(seconds - before)
            if change < MIN_CHANGE or change <= min(before / 4, MAX_CHANGE):
                return False
        self._recorded[player] = seconds
        return True


class MeasuredRoom(Protocol):
    """A room, as far as round trips go: see `Room`."""

    def record_round_trips(self) -> bool:
        """Record those that have changed; whether there were any."""


class RoundTripWatch:
    """Goes round all `live` rooms while there are any. One in which something is recorded takes a
    turn of the event loop for itself."""

    def __init__(self, live: Set[MeasuredRoom]) -> None:
        self._live = live
        self._timer: asyncio.Handle | None = None

    def begin(self) -> None:
        """There is a room to look after."""
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(LOOK_SECONDS, self._go_round)

    def stop(self) -> None:
        """Look no more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _go_round(self) -> None:
        self._timer = None
        if self._live:
            self._go_on(iter(list(self._live)))

    def _go_on(self, rooms: Iterator[MeasuredRoom]) -> None:
        for room in rooms:
            if room in self._live and room.record_round_trips():
                self._timer = asyncio.get_running_loop().call_soon(self._go_on, rooms)
                return
        self._timer = None
        self.begin()
