"""The accidents that happen to the page of a person, one in each phase of each game."""

from __future__ import annotations

import random
from enum import StrEnum
from itertools import cycle, islice

__all__ = ["ALL_ACCIDENTS", "ENTERING", "KILLED", "PHASES", "Accident", "Fates"]


class Accident(StrEnum):
    """Event that a page has to survive."""

    RELOADED = "reloaded"
    CLOSED = "closed"
    ASLEEP = "asleep"
    OFFLINE = "offline"
    MOVED = "moved"


ENTERING = "entering"
PHASES = (ENTERING, "waiting", "countdown", "running", "paused", "ended")
"""Phases of a game as its person knows them. The page has not joined while it is `entering`."""
KILLED = "server killed"
ALL_ACCIDENTS = frozenset(f"{accident} {phase}" for accident in Accident for phase in PHASES)
"""Names of all accidents in all phases."""


class Fates:
    """The accidents of one person.

    The accidents of a phase take turns. A phase that is missing in a game, such as a countdown,
    therefore has all accidents in the first five games that have this phase.

    Args:
        seed: The seed of the accidents' order.
        person: The person's number. Several people begin with different accidents.
    """

    def __init__(self, seed: int, person: int) -> None:
        kinds = list(Accident)
        random.Random(seed).shuffle(kinds)
        self._turns = {
            phase: islice(cycle(kinds), number + 2 * person, None)
            for number, phase in enumerate(PHASES)
        }
        self._open: set[str] = set()

    def begin(self) -> None:
        """Begin a new game."""
        self._open = set(PHASES)

    def wait(self, phase: str) -> bool:
        """Return whether an accident has not happened yet in a phase of this game."""
        return phase in self._open

    def take(self, phase: str) -> Accident:
        """Return the accident of a phase, which happens now."""
        self._open.remove(phase)
        return next(self._turns[phase])
