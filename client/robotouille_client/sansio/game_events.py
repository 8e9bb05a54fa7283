"""Events of an episode as a client receives them, and the results of its own actions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from robotouille.episode.lifecycle import Controller
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.signals import Signal
from robotouille.world.unmet import Unmet, UnmetKind, only_words
from robotouille.world.world import State, World

# Under these controllers, a seat's actions do not count for its participant.
NOT_PARTICIPANT = (Controller.ABSENT, Controller.SUBSTITUTE)


@dataclass(frozen=True, slots=True)
class TakenStep:
    """The actions of one step, read from a delta.

    Attributes:
        did: The actions as `(player, action, applied)`, in the order in which they were tried.
        decided: By player, the sequence number of the action and its unmet conditions.
        waits: The players who did nothing and declared that they wait.
    """

    did: tuple[tuple[str, GroundAction, bool], ...]
    decided: Mapping[str, tuple[int, tuple[Unmet, ...]]]
    waits: tuple[str, ...]

    @classmethod
    def of(cls, delta: messages.Delta, world: World) -> TakenStep:
        """Read a delta.

        Raises:
            RobotouilleError: The delta does not fit the world.
        """
        did, decided = [], {}
        # This check comes first, so that a faulty server cannot make the client parse rows without
        # limit.
        if max(len(delta.did), len(delta.waits)) > len(world.players):
            raise ProtocolError(ErrorCode.STATE_MISMATCH, "the step lists too many players")
        try:
            for i, (row, seq) in enumerate(zip(delta.did, delta.seq, strict=True)):
                player, place = _player(world, int(row[0])), str(i)
                action = world.action(str(row[1]), *map(str, row[2:]))
                did.append((player, action, place not in delta.unmet))
                unmet = unmet_from(delta.unmet.get(place, ()), delta.why.get(place, ()))
                decided[player] = (seq, unmet)
            waits = tuple(_player(world, number) for number in delta.waits)
        except (ValueError, IndexError) as error:
            message = "the step lists an unknown player or action"
            raise ProtocolError(ErrorCode.STATE_MISMATCH, message) from error
        return cls(tuple(did), decided, waits)

    def tallied(self, seats: Iterable[messages.SeatInfo]) -> tuple[messages.SeatInfo, ...]:
        """Return the roster's seats with the actions of this step added to their counts."""
        # The server sends a roster only when it changes, so clients keep the counts up to date.
        done = {player: applied for player, _, applied in self.did}
        return tuple(
            seat.model_copy(
                update={"acted": seat.acted + 1}
                if done[seat.player]
                else {"rejected": seat.rejected + 1}
            )
            if seat.player in done and seat.controller not in NOT_PARTICIPANT
            else seat
            for seat in seats
        )


def _player(world: World, number: int) -> str:
    if number < 0:  # A negative number would index from the end.
        raise IndexError(number)
    return world.players[number]


KINDS = {ErrorCode.ACTION_STALE: UnmetKind.STALE, ErrorCode.ACTION_UNKNOWN: UnmetKind.UNKNOWN}
"""Kinds of reasons without data, by error code."""


def unmet_from(
    words: Sequence[str], why: Sequence[messages.Why], code: str = ""
) -> tuple[Unmet, ...]:
    """Return unmet conditions from their texts and structured reasons."""
    if len(words) != len(why):  # The reasons are not about the action, such as a full quota.
        kinds = (kind for known, kind in KINDS.items() if known == code)
        return only_words(*words, kind=next(kinds, UnmetKind.OTHER))
    return tuple(each.value(text) for each, text in zip(why, words, strict=True))


@dataclass(frozen=True, slots=True)
class StateChanged:
    """A step was taken, or a snapshot arrived (then `did` is empty and `previous` None).

    Attributes:
        did: The actions of the step as `(player, action, applied)`.
        waits: The players who did nothing and declared that they wait.
    """

    step: int
    state: State
    previous: State | None = None
    did: tuple[tuple[str, GroundAction, bool], ...] = ()
    turn: str | None = None
    waits: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ObservationReceived:
    """The state in words arrived, with the valid actions of `seat` (None for a spectator).

    A client receives one observation for each of its seats.
    """

    step: int
    text: str
    actions: tuple[str, ...]
    turn: str | None = None
    seat: str | None = None


@dataclass(frozen=True, slots=True)
class ActRejected:
    """An action of one of the client's seats was rejected."""

    seq: int
    step: int
    action: str
    unmet: tuple[Unmet, ...]
    code: str
    seat: str = ""

    @property
    def reasons(self) -> tuple[str, ...]:
        """The unmet conditions in words."""
        return tuple(unmet.words for unmet in self.unmet)


@dataclass(frozen=True, slots=True)
class ChatReceived:
    """A participant wrote in the chat, or sent a signal. `text` is then the signal's sentence."""

    name: str
    seat: str
    text: str
    signal: Signal | None = None


@dataclass(frozen=True, slots=True)
class TeamTold:
    """A bot of the episode, possibly this one, told its version to all bots."""

    seat: str
    text: str


@dataclass(frozen=True, slots=True)
class ChatRepeated:
    """A chat message from before this program returned to the game."""

    name: str
    seat: str
    text: str


@dataclass(frozen=True, slots=True)
class ChatRejected:
    """A chat message or note of the client was rejected.

    `code` is `chat/phrase`, `chat/off`, `seat/muted` or `rate/words`.
    """

    code: str
    reason: str


@dataclass(frozen=True, slots=True)
class Announced:
    """The operator sent an announcement."""

    text: str


@dataclass(frozen=True, slots=True)
class RosterChanged:
    """The participants, the phase, the reason for a pause or the awaited seats changed.

    Attributes:
        waits_for: The seats that a step has waited for, for at least two seconds.
    """

    phase: str
    seats: tuple[messages.SeatInfo, ...]
    pause: messages.Pause | None = None
    waits_for: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class GameEnded:
    """The episode ended, or (with an empty `outcome`) the client is out of it.

    Attributes:
        code: The code of the server's `bye` message, if there was one.
    """

    outcome: Mapping[str, Any]
    reason: str = ""
    code: str = ""


GameEvent = (
    StateChanged
    | ObservationReceived
    | ActRejected
    | ChatReceived
    | TeamTold
    | ChatRepeated
    | ChatRejected
    | Announced
    | RosterChanged
    | GameEnded
)
"""Any event of an episode."""


@dataclass(frozen=True, slots=True)
class ActResult:
    """The result of an action: applied, or rejected with unmet conditions and an error code.

    Attributes:
        age: Number of steps from the basis of the action to the state in which it was tried, or
            rejected; None if that is unknown.
    """

    applied: bool
    step: int
    unmet: tuple[Unmet, ...] = ()
    code: str = ""
    age: int | None = None

    @classmethod
    def of(cls, step: int, unmet: tuple[Unmet, ...]) -> ActResult:
        """Return the result of an action that was tried in a step."""
        return cls(not unmet, step, unmet, ErrorCode.ACTION_INVALID if unmet else "")

    @property
    def reasons(self) -> tuple[str, ...]:
        """The unmet conditions in words."""
        return tuple(unmet.words for unmet in self.unmet)
