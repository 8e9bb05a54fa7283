"""When the steps of a real-time episode are due, as far as the arrivals of its deltas tell."""

from __future__ import annotations

from math import ceil, inf

__all__ = ["StepSchedule"]

SETTLED = 5
"""Deltas after which the estimate is used."""
WATCHED = 50
"""Deltas of which one at least must be less than half a period late."""


class StepSchedule:
    """The absolute schedule of one episode, estimated on the client's clock.

    A delta does not say when its step was due, but steps are due at a fixed rate. So the arrival
    that was earliest for its step is taken as punctual: `transit` seconds after the step was due.
    Every age is therefore relative to the episode's best delivery, and never too large by more
    than `transit` is too small.

    A server that is too far behind may give its schedule up and go on from a later time. That is
    seen when `WATCHED` deltas in a row are late by half a period: they count as late, the estimate
    begins anew, and `given_up` is one more.
    """

    __slots__ = ("_least", "_origin", "_period", "_seen", "_transit", "_watched", "given_up")

    def __init__(self, rate: float, transit: float = 0.0) -> None:
        self._period = 1 / rate
        self._transit = transit
        self.given_up = 0
        self.restart()

    def restart(self) -> None:
        """Forget the estimate: the episode stood still for a while."""
        self._origin = inf
        self._seen = 0
        self._watch_anew()

    def _watch_anew(self) -> None:
        self._watched = 0
        self._least = inf

    @property
    def settled(self) -> bool:
        """Whether enough has arrived for the estimate to be used."""
        return self._seen >= SETTLED

    def arrived(self, step: int, at: float) -> float:
        """Note the arrival of a step's delta; its age in seconds, by what is known now."""
        origin = at - self._transit - step * self._period
        self._origin = min(self._origin, origin)
        self._seen += 1
        late = origin - self._origin
        self._watch(origin, late)
        return late + self._transit

    def _watch(self, origin: float, late: float) -> None:
        self._watched += 1
        self._least = min(self._least, late)
        if self._watched >= WATCHED:
            if self._least > self._period / 2:
                self.given_up += 1
                self._origin = origin
            self._watch_anew()

    def due(self, step: int) -> float:
        """The time at which a step is due."""
        return self._origin + step * self._period

    def next_due(self, at: float) -> float:
        """The time of the first step that is due at or after `at`."""
        return self.due(ceil((at - self._origin) / self._period))
