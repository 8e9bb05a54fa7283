"""Which steps a timeline shows, and where."""

from __future__ import annotations

__all__ = ["Scale"]

MIN_SHOWN = 10
"""Steps that are shown at least."""


class Scale:
    """The part of an episode that is shown between two pixels: all of it, or less.

    `left` and `width` are those of the lanes in pixels, `first` is the first step that is shown.
    """

    def __init__(self) -> None:
        self.left = 0
        self.width = 1
        self.first = 0.0
        self._shown: float | None = None
        self._steps = (0, 0)

    @property
    def shown(self) -> float:
        """The number of steps that are shown."""
        return self._whole if self._shown is None else min(self._shown, self._whole)

    @property
    def last(self) -> float:
        """The last step that is shown."""
        return self.first + self.shown

    @property
    def _whole(self) -> float:
        return float(max(1, self._steps[1] - self._steps[0]))

    def place(self, left: int, width: int, first: int, last: int) -> None:
        """Where the lanes are, and which steps there are by now."""
        self.left, self.width, self._steps = left, max(1, width), (first, last)
        self._go(self.first)

    def x(self, step: float) -> int:
        """The pixel of a step."""
        return self.left + round((step - self.first) / self.shown * self.width)

    def step(self, x: int) -> int:
        """The step that is nearest to a pixel; one of those that are shown."""
        first, last = self._steps
        return min(last, max(first, round(self.first + self._share(x) * self.shown)))

    def zoom(self, x: int, factor: float) -> None:
        """Show so many times as many steps, with the one at a pixel where it is."""
        share = self._share(x)
        middle = self.first + share * self.shown
        wanted = max(float(MIN_SHOWN), self.shown * factor)
        self._shown = None if wanted >= self._whole else wanted
        self._go(middle - share * self.shown)

    def reveal(self, step: float) -> None:
        """Move to where a step is seen."""
        if step < self.first:
            self._go(step - self.shown * 0.1)
        elif step > self.last:
            self._go(step - self.shown * 0.9)

    def _share(self, x: int) -> float:
        """How far a pixel is from the left to the right end."""
        return min(1.0, max(0.0, (x - self.left) / self.width))

    def _go(self, first: float) -> None:
        """Begin at a step, if there are enough behind it."""
        lowest = float(self._steps[0])
        self.first = min(max(lowest, first), lowest + self._whole - self.shown)
