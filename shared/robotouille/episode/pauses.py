"""Reasons for which an episode is paused, and the time that pauses take."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum


# A new reason needs a member here and two calls, `Episode.pause` and `resume`; add it to `OUTER` if
# it is not about absent participants (docs/decisions/0015).
class PauseReason(StrEnum):
    """Reason for a pause, in the order in which reasons are shown."""

    OPERATOR = "operator"
    PLAYER = "player"
    """A player in a window of their own opened a card or the help."""
    STORAGE = "storage"
    RESTART = "restart"
    ABSENCE = "absence"
    DESERTED = "deserted"


OUTER = (PauseReason.OPERATOR, PauseReason.PLAYER, PauseReason.STORAGE, PauseReason.RESTART)
"""Reasons other than an absence. While one applies, the time of an absence does not count."""


@dataclass(slots=True)
class PauseReasons:
    """The reasons that apply now, with the times at which they end (None: open)."""

    until: dict[PauseReason, float | None] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.until)

    def __contains__(self, why: PauseReason) -> bool:
        return why in self.until

    @property
    def outer(self) -> bool:
        """True if a reason other than an absence applies."""
        return any(why in self.until for why in OUTER)

    @property
    def shown(self) -> tuple[PauseReason, float | None] | None:
        """The reason to show to participants, and when it ends."""
        for why in PauseReason:
            if why in self.until:
                return why, self.until[why]
        return None

    def due(self) -> float | None:
        """Return when the next reason ends by itself."""
        # An absence behind an outer reason must not wake the server either, or it would tick
        # without effect.
        ends = [end for why, end in self.until.items() if end is not None and self._counts(why)]
        return min(ends, default=None)

    def expired(self, now: float) -> list[PauseReason]:
        """Return the reasons that have come to their end."""
        return [
            why
            for why, end in self.until.items()
            if end is not None and end <= now and self._counts(why)
        ]

    def _counts(self, why: PauseReason) -> bool:
        return why in OUTER or not self.outer


class Stopwatch:
    """Running time of a game, without pauses. All times are in seconds since the start."""

    __slots__ = ("_lost", "_stopped")

    def __init__(self) -> None:
        self._stopped: float | None = None
        self._lost = 0.0

    def stop(self, time: float) -> None:
        """Stop, unless already stopped."""
        if self._stopped is None:
            self._stopped = time

    def go_on(self, time: float) -> None:
        """Run again."""
        if self._stopped is not None:
            # Never negative: recovery reads these times from a file, which may have them in any
            # order.
            self._lost += max(0.0, time - self._stopped)
            self._stopped = None

    def read(self, time: float) -> float:
        """Return the seconds for which the game has run."""
        return (time if self._stopped is None else self._stopped) - self._lost
