"""Activity of a seat in each step of an episode, and its counts."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any

from robotouille.episode.lifecycle import Controller


class Activity(StrEnum):
    """Activity of a seat in a step: the first of these that applies."""

    SUBSTITUTED = "substituted"
    """A substitute controlled the seat."""
    AWAY = "away"
    """The participant was absent, or the seat was free."""
    ACTED = "acted"
    """The participant's action was applied."""
    BUSY = "busy"
    """The player was walking or working and could not act."""
    WAITING = "waiting"
    """A request was rejected, the seat declared a wait, or it was another player's turn."""
    IDLE = "idle"
    """The player could act and did nothing."""


# Looked up once, because every step needs them for every seat.
SUBSTITUTE = Controller.SUBSTITUTE
NOBODY = (Controller.ABSENT, Controller.FREE)


def activity(
    controller: Controller, applied: bool | None, busy: bool, refused: bool, others_turn: bool
) -> Activity:
    """Return what a seat did in a step.

    Args:
        controller: The seat's controller in the step.
        applied: True if the seat's action in the step was applied; None without an action.
        busy: True if the player could not act in the state before the step.
        refused: True if a request since the step before was rejected and not superseded, or
            the seat declared a wait.
        others_turn: True if it was another player's turn.
    """
    if controller is SUBSTITUTE:
        return Activity.SUBSTITUTED
    if controller in NOBODY:
        return Activity.AWAY
    if applied:
        return Activity.ACTED
    if busy:
        return Activity.BUSY
    if refused or others_turn or applied is not None:
        return Activity.WAITING
    return Activity.IDLE


@dataclass(slots=True)
class SeatTally:
    """Counts for one seat over an episode. Actions of a substitute are not counted.

    Each step counts once, in the field named after its `Activity`; these fields sum to the steps.

    Attributes:
        rejected: Requests that were not applied, for whatever reason.
        invalid: Rejected actions whose preconditions did not hold on arrival.
        malformed: Rejected texts that named no action.
        said: Chat messages.
    """

    player: str
    acted: int = 0
    busy: int = 0
    waiting: int = 0
    idle: int = 0
    away: int = 0
    substituted: int = 0
    rejected: int = 0
    invalid: int = 0
    malformed: int = 0
    said: int = 0

    def count(self, what: Activity) -> None:
        """Count a step."""
        name = what._value_  # `value` is a descriptor in Python and takes twice as long.
        setattr(self, name, getattr(self, name) + 1)

    @property
    def steps(self) -> int:
        """Number of steps counted."""
        away = self.away + self.substituted
        return self.acted + self.busy + self.waiting + self.idle + away

    def without_waits(self) -> SeatTally:
        """Return the tally with the steps of waiting counted as idle."""
        return replace(self, waiting=0, idle=self.idle + self.waiting)

    def to_json(self) -> dict[str, Any]:
        """Return the tally as JSON values; `SeatTally(**row)` reads it back."""
        return asdict(self)
