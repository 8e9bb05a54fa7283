"""Smooth playback of real-time steps that arrive at irregular times.

Each step is shown a fixed delay after the time at which the fastest recent messages would have
arrived. The delay is long enough for 90 % of the messages. Late steps are caught up with.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from robotouille.world.world import State

MAX_DELAY = 0.25
"""Longest delay of a step in seconds. More would make the player's own actions feel slow."""
IN_TIME = 0.9
"""Share of the steps that should arrive before they are due."""
REMEMBERED = 50
"""Number of recent arrivals from which the delay is computed."""
SILENCE = 1.0
"""Lateness in seconds from which the server's clock is assumed to have stopped for a while."""
MAX_BEHIND = 1.5
"""Largest backlog in seconds that is caught up with; an older one is skipped."""
SETTLING = 0.3
"""Time constant in seconds for correcting the shown position."""
MIN_RATE, MAX_RATE = 0.5, 2.0
"""Limits of the playback speed."""


@dataclass(frozen=True, slots=True)
class ShownStep:
    """Step with its states, and the part of its time that has passed on the screen."""

    step: int
    state: State
    previous: State | None
    phase: float = 0.0


class Playout:
    """Queue of steps to show, and the current position in it.

    Args:
        period: Seconds from one step to the next.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._steps: deque[ShownStep] = deque()
        self._offsets: deque[float] = deque(maxlen=REMEMBERED)
        self._position = 0.0
        self._updated = 0.0

    @property
    def position(self) -> float:
        """Current position in steps; the fraction is the part of the step that has passed."""
        return self._position

    def add(self, step: int, state: State, previous: State | None) -> None:
        """Add a step. Without the state before it, the step is shown at once."""
        # A snapshot or a gap leaves no states to animate between.
        if self._steps and (previous is None or step != self._steps[-1].step + 1):
            self._steps.clear()
        if not self._steps:
            self._offsets.clear()
            self._position = float(step)
        self._steps.append(ShownStep(step, state, previous))

    def arrived(self, step: int, at: float) -> None:
        """Record when a step arrived, in seconds."""
        offset = at - step * self._period
        # A server that was paused or overloaded runs late from then on. The old offsets would
        # make every later step look late, so start measuring again.
        if self._offsets and offset - min(self._offsets) > SILENCE:
            self._offsets.clear()
        if not self._offsets:
            self._updated = max(self._updated, at)
        self._offsets.append(offset)

    def at(self, now: float) -> ShownStep | None:
        """Return what to show now; None before the first step."""
        if not self._steps:
            return None
        self._advance(now)
        while len(self._steps) > 1 and self._steps[1].step <= self._position:
            self._steps.popleft()
        shown = self._steps[0]
        # The position may run past the newest step while the next one is late; its picture waits.
        phase = min(1.0, max(0.0, self._position - shown.step))
        return ShownStep(shown.step, shown.state, shown.previous, phase)

    def _advance(self, now: float) -> None:
        passed, self._updated = max(0.0, now - self._updated), max(self._updated, now)
        if not self._offsets:
            return
        end = self._steps[-1].step + 1.0
        target = min(end, (now - self._zero_time()) / self._period)
        behind = (target - self._position) * self._period
        # After a long gap, replaying everything would show the past for many seconds.
        if behind - passed > MAX_BEHIND:
            self._position = target
            return
        # A rate proportional to the error closes it smoothly. The minimum keeps the picture
        # moving forward even if it is ahead, because walking backwards would look wrong.
        rate = min(MAX_RATE, max(MIN_RATE, 1.0 + (behind - passed) / SETTLING))
        self._position = min(end, self._position + passed / self._period * rate)

    def _zero_time(self) -> float:
        """Return when step 0 is due: the fastest arrival plus the delay."""
        # The fastest message saw the least queueing, so it measures the clock best. A quantile
        # instead of the maximum keeps a single slow message from delaying the whole game.
        offsets = sorted(self._offsets)
        most = offsets[min(len(offsets) - 1, round(IN_TIME * len(offsets)))]
        return offsets[0] + min(MAX_DELAY, most - offsets[0])
