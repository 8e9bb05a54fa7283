"""Which steps a timeline shows, and where."""

from __future__ import annotations

__all__ = ["Scale"]

FEWEST = 10
"""Steps that are shown at least."""


class Scale:
    """The part of an episode that is shown between two pixels: all of it, or less.

    `left` and `width` are those of the lanes in pixels.
    """

    def __init__(self) -> None:
        self.left = 0
        self.width = 1
        self.first = 0.0
        self._shown: float | None = None
        self._length = 0

    @property
    def shown(self) -> float:
        """The number of steps that are shown."""
        whole = float(max(1, self._length))
        return whole if self._shown is None else min(self._shown, whole)

    @property
    def last(self) -> float:
        """The last step that is shown."""
        return self.first + self.shown

    def place(self, left: int, width: int, length: int) -> None:
        """Where the lanes are, and how many steps there are by now."""
        self.left, self.width, self._length = left, max(1, width), length
        self.first = min(max(0.0, self.first), max(1, length) - self.shown)

    def x(self, step: float) -> int:
        """The pixel of a step."""
        return self.left + round((step - self.first) / self.shown * self.width)

    def step(self, x: int) -> int:
        """The step that is nearest to a pixel; one of those that are shown."""
        share = min(1.0, max(0.0, (x - self.left) / self.width))
        return min(self._length, max(0, round(self.first + share * self.shown)))

    def zoom(self, x: int, factor: float) -> None:
        """Show so many times as many steps, with the one at a pixel where it is."""
        share = min(1.0, max(0.0, (x - self.left) / self.width))
        middle = self.first + share * self.shown
        whole = float(max(1, self._length))
        wanted = max(float(FEWEST), self.shown * factor)
        self._shown = None if wanted >= whole else wanted
        self.first = min(max(0.0, middle - share * self.shown), whole - self.shown)

    def reveal(self, step: float) -> None:
        """Move to where a step is seen."""
        if step < self.first:
            self.first = max(0.0, step - self.shown * 0.1)
        elif step > self.last:
            self.first = min(step - self.shown * 0.9, max(1, self._length) - self.shown)
