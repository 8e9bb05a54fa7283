"""When the steps of a game in real time are shown: evenly, though they arrive unevenly.

A step is shown as long after the quickest one of late as most of them need; one that takes longer
is caught up with. What is shown never goes back, and skips nothing but a long silence.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robotouille.episode import Clock
from robotouille.world.world import State

__all__ = ["MAX_DELAY", "MAX_RATE", "Playout", "ShownStep", "real_time_rate"]

MAX_DELAY = 0.25
"""Seconds for which a step is held back at most, so that others may come later than it did."""
IN_TIME = 0.9
"""The share of the steps that are to be in time."""
REMEMBERED = 50
"""Steps whose arrival says how even the line is."""
SILENCE = 1.0
"""Seconds after which a step that is late says that the server's clock has stood still."""
MAX_BEHIND = 1.5
"""Seconds of steps that are caught up with; what is further back is not shown."""
SETTLING = 0.3
"""Seconds in which most of a difference to where the picture ought to be is made up."""
MIN_RATE, MAX_RATE = 0.5, 2.0
"""Of steps that are shown to steps that are taken."""
SLOWEST, FASTEST = 1e-4, 1e4
"""Steps a second of a clock that can be shown; the rules allow fewer."""


@dataclass(frozen=True, slots=True)
class ShownStep:
    """A step, its states, and how much of its period has passed on the screen."""

    step: int
    state: State
    previous: State | None
    phase: float = 0.0


class Playout:
    """The steps that are still to be shown, and how far one is.

    Args:
        period: Seconds from one step to the next.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._steps: deque[ShownStep] = deque()
        self._offsets: deque[float] = deque(maxlen=REMEMBERED)
        self._position = 0.0
        self._looked = 0.0

    @property
    def position(self) -> float:
        """Where one is: the step that is shown, and the share of it that has passed."""
        return self._position

    def add(self, step: int, state: State, previous: State | None) -> None:
        """A step is known; without the state before it, it is shown at once."""
        if self._steps and (previous is None or step != self._steps[-1].step + 1):
            self._steps.clear()
        if not self._steps:
            self._offsets.clear()
            self._position = float(step)
        self._steps.append(ShownStep(step, state, previous))

    def arrived(self, step: int, at: float) -> None:
        """When a step arrived, in seconds."""
        offset = at - step * self._period
        if self._offsets and offset - min(self._offsets) > SILENCE:
            self._offsets.clear()
        if not self._offsets:
            self._looked = max(self._looked, at)
        self._offsets.append(offset)

    def at(self, now: float) -> ShownStep | None:
        """What is to be shown now; None before anything is known."""
        if not self._steps:
            return None
        self._go_on(now)
        while len(self._steps) > 1 and self._steps[1].step <= self._position:
            self._steps.popleft()
        shown = self._steps[0]
        phase = min(1.0, max(0.0, self._position - shown.step))
        return ShownStep(shown.step, shown.state, shown.previous, phase)

    def _go_on(self, now: float) -> None:
        passed, self._looked = max(0.0, now - self._looked), max(self._looked, now)
        if not self._offsets:
            return
        end = self._steps[-1].step + 1.0
        ought = min(end, (now - self._quickest_and_delay()) / self._period)
        behind = (ought - self._position) * self._period
        if behind - passed > MAX_BEHIND:
            self._position = ought
            return
        rate = min(MAX_RATE, max(MIN_RATE, 1.0 + (behind - passed) / SETTLING))
        self._position = min(end, self._position + passed / self._period * rate)

    def _quickest_and_delay(self) -> float:
        """When step 0 is shown: as the quickest would have arrived, and the delay after it."""
        offsets = sorted(self._offsets)
        most = offsets[min(len(offsets) - 1, round(IN_TIME * len(offsets)))]
        return offsets[0] + min(MAX_DELAY, most - offsets[0])


def real_time_rate(rules: Mapping[str, Any]) -> float | None:
    """The steps a second of a game with some rules; None where its steps wait for decisions, or
    where nobody could show so many or so few."""
    rate = rules.get("step_rate") if rules.get("clock") == Clock.REALTIME else None
    if isinstance(rate, int | float) and SLOWEST <= rate <= FASTEST:
        return float(rate)
    return None
