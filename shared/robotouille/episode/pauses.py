"""Why an episode stands still, and for how long.

Pauses begin and end in `episode.py` (`pause`, `resume`, and what runs out of time) and in
`presence.py` (who is away, and comes back).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

__all__ = ["PauseReason", "PauseReasons"]


class PauseReason(StrEnum):
    """A reason for which time stands still."""

    OPERATOR = "operator"
    STORAGE = "storage"
    RESTART = "restart"
    ABSENCE = "absence"
    DESERTED = "deserted"


OUTER = (PauseReason.OPERATOR, PauseReason.STORAGE, PauseReason.RESTART)
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
