"""Whom a step waits for, published once that has taken a while."""

from __future__ import annotations

from collections.abc import Callable

from robotouille.episode import Episode
from robotouille_server.runtime.timer_queue import TimerHandle, TimerQueue

__all__ = ["WAITING_SECONDS", "SlowSeats"]

WAITING_SECONDS = 2.0
"""For how long a step waits before it is published for whom; nothing is of those that take less."""


class SlowSeats:
    """Looks at an episode every now and then, not at each of its steps; `publish` sends everybody
    whom it waits for. `waits_for` are those whom that named last, empty while nobody waits long.
    """

    __slots__ = ("_episode", "_now", "_publish", "_since", "_timer", "_timers", "waits_for")

    def __init__(
        self,
        episode: Episode,
        timers: TimerQueue,
        publish: Callable[[], None],
    ) -> None:
        self.waits_for: tuple[str, ...] = ()
        self._episode = episode
        self._timers = timers
        self._now = timers.time
        self._publish = publish
        self._since = 0.0
        self._timer: TimerHandle | None = None

    @property
    def still(self) -> tuple[str, ...]:
        """Of the step whose long wait was published: those that it waits for at present."""
        if not self.waits_for or self._episode.step_began != self._since:
            return ()
        return self._episode.waits_for

    def begin(self) -> None:
        """Time runs (again): look from now on whether a step takes long."""
        if self._timer is None and not self._episode.scheduled:
            self._look_at(self._now() + WAITING_SECONDS)

    def stop(self) -> None:
        """Look no more."""
        if self._timer is not None:
            self._timers.cancel(self._timer)
            self._timer = None

    def check(self) -> None:
        """Something has happened in a long wait: is it over, or for others?"""
        if self.still != self.waits_for:
            self.published()
            self._publish()

    def published(self) -> None:
        """The roster is about to be published: for whom the step still waits, too."""
        if self.waits_for:
            self.waits_for = self.still
            if not self.waits_for:
                self.begin()

    def _look_at(self, due: float) -> None:
        self._timer = self._timers.call_at(due, self._on_time)

    def _on_time(self, due: float) -> None:
        self._timer = None
        episode, now = self._episode, max(due, self._now())
        if not episode.running:
            return  # `begin` is called when time runs again.
        waits_for = episode.waits_for
        if not waits_for:
            self._look_at(now + WAITING_SECONDS)
        elif now < (long := episode.step_began + WAITING_SECONDS):
            self._look_at(long)
        else:
            self.waits_for, self._since = waits_for, episode.step_began
            self._publish()
