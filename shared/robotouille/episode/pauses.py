"""Why an episode stands still, and for how long."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

__all__ = ["Hold", "Holds"]


class Hold(StrEnum):
    """A reason for which time stands still."""

    OPERATOR = "operator"
    STORAGE = "storage"
    RESTART = "restart"
    ABSENCE = "absence"
    DESERTED = "deserted"


OUTER = (Hold.OPERATOR, Hold.STORAGE, Hold.RESTART)
"""Reasons that are nobody's absence; while one holds, no absence counts."""


@dataclass(slots=True)
class Holds:
    """The reasons that hold at present, each with the time at which it ends (None: open)."""

    until: dict[Hold, float | None] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.until)

    def __contains__(self, why: Hold) -> bool:
        return why in self.until

    @property
    def outer(self) -> bool:
        return any(why in self.until for why in OUTER)

    @property
    def shown(self) -> tuple[Hold, float | None] | None:
        """The reason to tell first, and when it ends."""
        for why in Hold:
            if why in self.until:
                return why, self.until[why]
        return None

    def due(self) -> float | None:
        """When the next of them ends by itself."""
        ends = [end for why, end in self.until.items() if end is not None and self._counts(why)]
        return min(ends, default=None)

    def expired(self, now: float) -> list[Hold]:
        """Those that have come to their end."""
        return [
            why
            for why, end in self.until.items()
            if end is not None and end <= now and self._counts(why)
        ]

    def _counts(self, why: Hold) -> bool:
        return why in OUTER or not self.outer
