"""What a seat does with each step of an episode, and how that is counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from robotouille.episode.lifecycle import Controller

__all__ = ["Activity", "SeatTally", "activity"]


class Activity(StrEnum):
    """What a seat did with one step: exactly one of these, the first that holds."""

    SUBSTITUTED = "substituted"
    """A stand-in was in control, whatever it did."""
    AWAY = "away"
    """Nobody moved it: its participant was absent, or it was free."""
    ACTED = "acted"
    """Its participant's action was applied."""
    BUSY = "busy"
    """It was walking or working, and could not act."""
    WAITING = "waiting"
    """It asked for something that was refused or lost in the step, said that it waits, or it was
    another's turn."""
    IDLE = "idle"
    """It could act, and did nothing."""


STAND_IN = Controller.STAND_IN
NOBODY = (Controller.ABSENT, Controller.FREE)
"""Looked up once: a step asks for each of its seats."""


def activity(
    controller: Controller, applied: bool | None, busy: bool, refused: bool, others_turn: bool
) -> Activity:
    """What a seat did with a step.

    Args:
        controller: Who moved it in the step.
        applied: Whether its action in the step was; None if it had none.
        busy: It could not act in the state before the step.
        refused: Something that it asked for since the step before was taken into none, and not
            because it asked for something else instead; or it said that it waits.
        others_turn: With the turn clock, another's turn.
    """
    if controller is STAND_IN:
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
    """What one seat did over an episode.

    Each step counts as one of `acted`, `busy`, `waiting`, `idle`, `away` and `substituted` (see
    `Activity`), so that they sum to the steps. What a stand-in asks for is not counted.

    `rejected` counts everything that was asked for and not done. Of these, `invalid` are known
    actions that were not valid when they were asked for, and `malformed` texts that were no action
    at all; the rest were replaced by a later one, were lost to another's in their step, or were
    not looked at. `said` are chat messages.
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
        """One more step."""
        name = what._value_  # As `value`, in half the time.
        setattr(self, name, getattr(self, name) + 1)

    @property
    def steps(self) -> int:
        """The steps that are counted."""
        away = self.away + self.substituted
        return self.acted + self.busy + self.waiting + self.idle + away

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> SeatTally:
        """The tally that `to_json` wrote; earlier versions wrote `applied` for `acted`, and no
        `busy`, `waiting`, `away` and `substituted`.

        Raises:
            TypeError: It has a field that is not known.
        """
        return cls(**{"acted" if key == "applied" else key: value for key, value in row.items()})

    def to_json(self) -> dict[str, Any]:
        """The tally as JSON values."""
        return asdict(self)
