"""Where a viewer is in an episode, and how fast it goes on; time is injected."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["SPEEDS", "Playhead"]

SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Multiples of the rate at which steps pass."""


class Playhead:
    """A position between step 0 and the last one, which moves by itself while it plays.

    Args:
        length: The number of steps, which may grow.
        rate: Steps a second at speed 1.
        now: A clock in seconds.
        first: The first step that there is.
        live: The episode is still going on: it begins at the end, and stays there as that moves on,
            until somebody goes elsewhere.
    """

    def __init__(
        self,
        length: Callable[[], int],
        rate: float,
        now: Callable[[], float],
        *,
        first: int = 0,
        live: bool = False,
    ) -> None:
        self.rate = rate
        self.first = first
        self.live = live
        self._length = length
        self._now = now
        self._speed = SPEEDS.index(1.0)
        self._from = float(length() if live else first)
        self._since: float | None = None if live else now()
        self._at_end = live

    @property
    def length(self) -> int:
        """The number of steps so far."""
        return self._length()

    @property
    def speed(self) -> float:
        """The multiple of the rate."""
        return SPEEDS[self._speed]

    @property
    def playing(self) -> bool:
        """Whether it moves by itself."""
        return self._since is not None and not self.follows

    @property
    def follows(self) -> bool:
        """Whether it stays at the end of an episode that is going on."""
        return self.live and self._at_end

    @property
    def position(self) -> float:
        """Steps from the beginning: between two numbers the later step is being taken."""
        if self.follows:
            return float(self.length)
        if self._since is None:
            return self._from
        reached = self._from + (self._now() - self._since) * self.rate * self.speed
        if reached < self.length:
            return reached
        self.seek(self.length, playing=False)
        return self._from

    @property
    def step(self) -> int:
        """The step that is taken at present, or was taken last."""
        position = self.position
        return int(position) + (position % 1 > 0)

    def seek(self, position: float, *, playing: bool | None = None) -> None:
        """Go to a position; `playing` says whether to go on from there, None: as before."""
        goes_on = self._since is not None if playing is None else playing
        self._from = min(max(float(self.first), float(position)), float(self.length))
        at_end = self._from >= self.length
        self._at_end = self.live and at_end
        self._since = self._now() if goes_on and not at_end else None

    def move(self, steps: int) -> None:
        """Go some whole steps forwards or back, and stay there."""
        position = self.position
        start = int(position) if steps > 0 else self.step
        self.seek(start + steps, playing=False)

    def toggle(self) -> None:
        """Stop or go on; at the end, begin anew."""
        if self.playing:
            self.seek(self.step, playing=False)
        elif self.follows:
            self._from, self._at_end = float(self.length), False
        else:
            position = self.position
            self.seek(0 if position >= self.length else position, playing=True)

    def change_speed(self, by: int) -> None:
        """So many notches faster, or slower."""
        position, playing = self.position, self.playing
        self._speed = min(max(0, self._speed + by), len(SPEEDS) - 1)
        if not self.follows:
            self.seek(position, playing=playing)
