"""Seats: the players of a world, who plays them, and what became of their actions."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from robotouille.episode.events import SeatTally
from robotouille.episode.quota import SEAT_QUOTA_BYTES, Quota
from robotouille.world.grounding.actions import GroundAction

__all__ = ["ActionAnswer", "Controller", "Departure", "Pending", "Seat"]


class Controller(StrEnum):
    """Who moves a seat: its participant (by kind), nobody, or a bot in an absent one's place."""

    FREE = ""
    HUMAN = "human"
    BOT = "bot"
    MODEL = "model"
    ABSENT = "absent"
    STAND_IN = "stand-in"


class Departure(StrEnum):
    """Why a participant has no seat any more."""

    LEFT = "left"
    LOST = "lost"
    REMOVED = "removed"


@dataclass(slots=True)
class Pending:
    """An action that waits for its step; None is the decision to do nothing. A stand-in's has
    the sequence number 0."""

    action: GroundAction | None
    seq: int
    latency: float
    order: int
    due_step: int
    reasoning: str = ""


class ActionAnswer(NamedTuple):
    """What became of a seat's action: taken in `step`, or rejected for some reasons."""

    seq: int
    step: int
    reasons: tuple[str, ...] = ()


@dataclass(slots=True)
class Seat:
    """A player of the world and who plays it.

    `words` is how much of what is written in its name is recorded.

    `session` is who holds the seat, `participant` its pseudonym, `generation` that of the resume
    token which was used last. `asked` is when it was last asked to move, `away` since when it is
    absent, `answer` what became of the last of its actions that was decided.
    """

    player: str
    name: str = ""
    kind: str = ""
    session: str = ""
    participant: str = ""
    generation: int = 0
    taken: bool = False
    present: bool = False
    controller: Controller = Controller.FREE
    seq: int = 0
    asked: float = 0.0
    away: float = 0.0
    pending: Pending | None = None
    answer: ActionAnswer = field(default_factory=lambda: ActionAnswer(0, 0))
    tally: SeatTally = field(default_factory=lambda: SeatTally(""))
    words: Quota = field(default_factory=lambda: Quota(SEAT_QUOTA_BYTES))

    @property
    def active(self) -> bool:
        """Whether somebody decides for it."""
        return self.present or self.controller is Controller.STAND_IN

    def take(self, name: str, kind: str, session: str, participant: str, now: float) -> None:
        """A newcomer sits down."""
        self.name, self.kind = name, kind
        self.session, self.participant, self.generation = session, participant, 0
        self.taken = self.present = True
        self.words.renew()
        self.asked = now
        self.seq, self.pending, self.answer = 0, None, ActionAnswer(0, 0)

    def free(self) -> None:
        """Nobody's seat any more."""
        self.taken = self.present = False
        self.name = self.kind = self.session = self.participant = ""
        self.generation = 0
        self.pending = None
