"""When everybody is told that somebody watches, or does not any more: gathered, and not too often.

Spectators cost nothing to be and leave nothing in a recording, so nothing limits how often they
come and go. What players and other spectators are sent because of them must not grow with it.
"""

from __future__ import annotations

from collections.abc import Callable

from robotouille_server.runtime.timer_queue import TimerHandle, TimerQueue

__all__ = ["ROSTER_SECONDS", "SpectatorRosters"]

ROSTER_SECONDS = 0.25
"""Between two rosters that only spectators bring about."""


class SpectatorRosters:
    """Calls `publish` for what spectators do: in the next turn of the event loop, or once
    `ROSTER_SECONDS` have passed since the last time; not while `withheld` says so."""

    __slots__ = ("_publish", "_rested_at", "_timer", "_timers", "_wanted", "_withheld")

    def __init__(
        self, timers: TimerQueue, withheld: Callable[[], bool], publish: Callable[[], None]
    ) -> None:
        self._timers = timers
        self._withheld = withheld
        self._publish = publish
        self._wanted = False
        self._rested_at = timers.time()
        self._timer: TimerHandle | None = None

    def changed(self) -> None:
        """Somebody watches from now on, or does not any more."""
        self._wanted = True
        self._look_later()

    def released(self) -> None:
        """Nothing is withheld any more."""
        if self._wanted:
            self._look_later()

    def _look_later(self) -> None:
        if self._timer is None:
            due = max(self._timers.time(), self._rested_at)
            self._timer = self._timers.call_at(due, self._on_time)

    def _on_time(self, due: float) -> None:
        self._timer = None
        if self._wanted and not self._withheld():
            self._wanted = False
            self._rested_at = max(due, self._timers.time()) + ROSTER_SECONDS
            self._publish()
