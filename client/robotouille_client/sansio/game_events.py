"""What happens in a game, as its participants are told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.unmet import Unmet
from robotouille.world.world import State

__all__ = [
    "ActResult",
    "Announced",
    "Changed",
    "GameEvent",
    "Heard",
    "NotSaid",
    "Observed",
    "Over",
    "Refused",
    "RosterChanged",
]


@dataclass(frozen=True, slots=True)
class Changed:
    """The state is another: a step was taken, or (`did` empty, `previous` None) a snapshot came.

    `did` are the actions of the step as `(player, action, applied)`, `waits` the players who did
    nothing and said that they wait.
    """

    step: int
    state: State
    previous: State | None = None
    did: tuple[tuple[str, GroundAction, bool], ...] = ()
    turn: str | None = None
    waits: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Observed:
    """The state in words, with the seat's valid actions (text view); one for each of one's seats.
    A spectator has no seat."""

    step: int
    text: str
    actions: tuple[str, ...]
    turn: str | None = None
    seat: str | None = None


@dataclass(frozen=True, slots=True)
class Refused:
    """An action of one's seat, or of one of them, was not taken, and why."""

    seq: int
    step: int
    action: str
    unmet: tuple[Unmet, ...]
    code: str
    seat: str = ""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why, in words."""
        return tuple(unmet.words for unmet in self.unmet)


@dataclass(frozen=True, slots=True)
class Heard:
    """Somebody said something."""

    name: str
    seat: str
    text: str


@dataclass(frozen=True, slots=True)
class NotSaid:
    """What one said, or had recorded, was not taken: `code` is that of the server's error
    (`chat/phrase`, `chat/off`, `seat/muted`, `rate/words`), `reason` says it in words."""

    code: str
    reason: str


@dataclass(frozen=True, slots=True)
class Announced:
    """The server's operator said something."""

    text: str


@dataclass(frozen=True, slots=True)
class RosterChanged:
    """Who plays, whether all seats are taken, why the game stands still if it does, and whom a
    step has waited for, for two seconds at least."""

    phase: str
    seats: tuple[messages.SeatInfo, ...]
    pause: messages.Pause | None = None
    waits_for: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Over:
    """The episode is over, or (`outcome` empty) the participant is out of it: `code` is that of
    the server's `bye`, if there was one."""

    outcome: Mapping[str, Any]
    reason: str = ""
    code: str = ""


GameEvent = Changed | Observed | Refused | Heard | NotSaid | Announced | RosterChanged | Over
"""Whatever one is told in a game."""


@dataclass(frozen=True, slots=True)
class ActResult:
    """What became of an action."""

    applied: bool
    step: int
    unmet: tuple[Unmet, ...] = ()
    code: str = ""

    @classmethod
    def of(cls, step: int, unmet: tuple[Unmet, ...]) -> ActResult:
        """That of an action that was looked at in a step: applied, if nothing was unmet."""
        return cls(not unmet, step, unmet, ErrorCode.ACTION_INVALID if unmet else "")

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it was rejected, in words."""
        return tuple(unmet.words for unmet in self.unmet)
