"""Playhead and state of a viewer: where it is, how fast it plays, what its owner has chosen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

# Multiples of the normal rate.
SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)


class Playhead:
    """Position between the first and the last step, which moves by itself while it plays.

    Args:
        length: Returns the number of steps, which may grow.
        rate: Steps a second at speed 1.
        now: Clock in seconds.
        first: First step.
        live: True for a game that is still going on. The playhead then starts at its end and
            stays there until it is moved.
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
        """Number of steps so far."""
        return self._length()

    @property
    def speed(self) -> float:
        """Multiple of the rate."""
        return SPEEDS[self._speed]

    @property
    def playing(self) -> bool:
        """True while it moves by itself."""
        return self._since is not None and not self.follows

    @property
    def follows(self) -> bool:
        """True while it stays at the end of a live game."""
        return self.live and self._at_end

    @property
    def position(self) -> float:
        """Steps since the beginning. Between two numbers, the later step is in progress."""
        if self.follows:
            return float(self.length)
        if self._since is None:
            return self._from
        reached = self._from + (self._now() - self._since) * self.rate * self.speed
        if reached < self.length:
            return reached
        # Nothing else notices the end, because the position is computed from the clock.
        self.seek(self.length, playing=False)
        return self._from

    @property
    def step(self) -> int:
        """Step in progress, or the last one taken."""
        position = self.position
        return int(position) + (position % 1 > 0)

    def seek(self, position: float, *, playing: bool | None = None) -> None:
        """Go to a position, then play or stop; None keeps on doing either."""
        # A position and a time are stored, so that the frame rate does not matter.
        goes_on = self._since is not None if playing is None else playing
        self._from = min(max(float(self.first), float(position)), float(self.length))
        at_end = self._from >= self.length
        self._at_end = self.live and at_end
        self._since = self._now() if goes_on and not at_end else None

    def move(self, steps: int) -> None:
        """Go some steps forward or back, and stop there."""
        position = self.position
        start = int(position) if steps > 0 else self.step
        self.seek(start + steps, playing=False)

    def toggle(self) -> None:
        """Play or stop; at the end, start over."""
        if self.playing:
            self.seek(self.step, playing=False)
        elif self.follows:
            self._from, self._at_end = float(self.length), False
        else:
            position = self.position
            self.seek(0 if position >= self.length else position, playing=True)

    def change_speed(self, by: int) -> None:
        """Go up or down in SPEEDS."""
        position, playing = self.position, self.playing
        self._speed = min(max(0, self._speed + by), len(SPEEDS) - 1)
        if not self.follows:
            self.seek(position, playing=playing)


MESSAGE_SECONDS = 8.0


@dataclass(slots=True)
class JobProgress:
    """Progress of a background job; `done` is a share, or None if unknown."""

    words: str
    stop: Callable[[], None]
    done: float | None = None


@dataclass(slots=True)
class ViewerState:
    """Choices of a viewer's owner.

    Attributes:
        followed: Player being followed.
        first: First step of the marked clip; None if it is not marked.
        last: Last step of the marked clip; None if it is not marked.
        log: True while the log is open.
        help: True while the help is open.
        jobs: Running background jobs by subject.
    """

    now: Callable[[], float]
    followed: str | None = None
    first: int | None = None
    last: int | None = None
    log: bool = False
    help: bool = False
    jobs: dict[str, JobProgress] = field(default_factory=dict)
    _message: str = field(default="", repr=False)
    _until: float = field(default=0.0, repr=False)

    @property
    def message(self) -> str:
        """Newest message, for a few seconds."""
        return self._message if self.now() < self._until else ""

    def show_message(self, message: str) -> None:
        """Show a message for a few seconds."""
        self._message, self._until = message, self.now() + MESSAGE_SECONDS

    def span(self, length: int) -> tuple[int, int]:
        """Return the first and last step of the marked clip, or of the whole game."""
        first = 0 if self.first is None else min(self.first, length)
        last = length if self.last is None else min(self.last, length)
        return min(first, last), max(first, last)
