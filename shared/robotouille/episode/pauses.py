"""Why an episode stands still, and for how long.

Pauses begin and end in `episode.py` (`pause`, `resume`, and what runs out of time) and in
`presence.py` (who is away, and comes back).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

__all__ = ["PauseReason", "PauseReasons", "Stopwatch"]


class PauseReason(StrEnum):
    """A reason for which time stands still."""

    OPERATOR = "operator"
    PLAYER = "player"
    """Whoever plays alone, or with bots in the same window, looks at a card or the help."""
    STORAGE = "storage"
    RESTART = "restart"
    ABSENCE = "absence"
    DESERTED = "deserted"


OUTER = (PauseReason.OPERATOR, PauseReason.PLAYER, PauseReason.STORAGE, PauseReason.RESTART)
"""Reasons that are nobody's absence; while one applies, no absence counts."""


@dataclass(slots=True)
class PauseReasons:
    """The reasons that apply at present, each with the time at which it ends (None: open)."""

    until: dict[PauseReason, float | None] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.until)

    def __contains__(self, why: PauseReason) -> bool:
        return why in self.until

    @property
    def outer(self) -> bool:
        return any(why in self.until for why in OUTER)

    @property
    def shown(self) -> tuple[PauseReason, float | None] | None:
        """The reason to tell first, and when it ends."""
        for why in PauseReason:
            if why in self.until:
                return why, self.until[why]
        return None

    def due(self) -> float | None:
        """When the next of them ends by itself."""
        ends = [end for why, end in self.until.items() if end is not None and self._counts(why)]
        return min(ends, default=None)

    def expired(self, now: float) -> list[PauseReason]:
        """Those that have come to their end."""
        return [
            why
            for why, end in self.until.items()
            if end is not None and end <= now and self._counts(why)
        ]

    def _counts(self, why: PauseReason) -> bool:
        return why in OUTER or not self.outer


class Stopwatch:
    """For how long a game has run, without the time in which it stood still. All times are in
    seconds since the game began."""

    __slots__ = ("_lost", "_stopped")

    def __init__(self) -> None:
        self._stopped: float | None = None
        self._lost = 0.0

    def stop(self, time: float) -> None:
        """Time stands still from here on, unless it does already."""
        if self._stopped is None:
            self._stopped = time

    def go_on(self, time: float) -> None:
        """Time runs again."""
        if self._stopped is not None:
            self._lost += max(0.0, time - self._stopped)
            self._stopped = None

    def read(self, time: float) -> float:
        """The seconds for which the game has run."""
        return (time if self._stopped is None else self._stopped) - self._lost
