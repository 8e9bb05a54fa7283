"""What a study does to a seat: whom others see in it, and how late its actions come."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from itertools import count
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["MAX_DELAY_MS", "NO_TREATMENT", "HeldActions", "SeatTreatment", "ShownKind"]

MAX_DELAY_MS = 10_000
ShownKind = Literal["human", "bot", "model"]


class SeatTreatment(BaseModel):
    """What a study does to a seat.

    Others see a participant of the kind `shown_as`, whatever plays. Each action of the seat is
    held back by `delay_ms` milliseconds before it counts, as if it had come so much later: it is
    checked only then.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    shown_as: ShownKind | None = None
    delay_ms: Annotated[int, Field(ge=0, le=MAX_DELAY_MS)] = 0


NO_TREATMENT = SeatTreatment()


class HeldActions:
    """Actions that have come and do not count yet. Times are in seconds, as the episode's."""

    __slots__ = ("_held", "_order")

    def __init__(self) -> None:
        self._held: list[tuple[float, int, str, Callable[[float], None]]] = []
        self._order = count()

    def hold(self, player: str, until: float, take: Callable[[float], None]) -> None:
        """Keep an action of a player; `take` is called with the time when it counts."""
        heapq.heappush(self._held, (until, next(self._order), player, take))

    def due(self) -> float | None:
        """When the next one counts."""
        return self._held[0][0] if self._held else None

    def release(self, now: float) -> None:
        """Let those count whose time has come, in its order."""
        while self._held and self._held[0][0] <= now:
            heapq.heappop(self._held)[3](now)

    def drop(self, player: str) -> None:
        """Forget those of a player who has left."""
        self._held = [held for held in self._held if held[2] != player]
        heapq.heapify(self._held)

    def clear(self) -> None:
        """Forget all: the game is over."""
        self._held.clear()
