"""What a delta says of one step: who did what, who waits, and what became of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from robotouille.episode.lifecycle import Controller
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.unmet import Unmet, from_words
from robotouille.world.world import World

__all__ = ["TakenStep", "told_unmet"]

NOT_THEIRS = (Controller.ABSENT, Controller.STAND_IN)
"""Who moves a seat while what it does is not its participant's."""


@dataclass(frozen=True, slots=True)
class TakenStep:
    """A step as it was told.

    `did` are the actions as `(player, action, applied)`, in the order in which they were tried;
    `decided` has the sequence number of each, by player, and why it was not applied. `waits` are
    the players who did nothing and said that they wait.
    """

    did: tuple[tuple[str, GroundAction, bool], ...]
    decided: Mapping[str, tuple[int, tuple[Unmet, ...]]]
    waits: tuple[str, ...]

    @classmethod
    def of(cls, delta: messages.Delta, world: World) -> TakenStep:
        """Read a delta; RobotouilleError if what it says makes no sense in a world."""
        did, decided = [], {}
        if max(len(delta.did), len(delta.waits)) > len(world.players):
            raise ProtocolError(ErrorCode.STATE_MISMATCH, "a step by more than there are")
        try:
            for i, (row, seq) in enumerate(zip(delta.did, delta.seq, strict=True)):
                player, place = _player(world, int(row[0])), str(i)
                action = world.action(str(row[1]), *map(str, row[2:]))
                did.append((player, action, place not in delta.unmet))
                unmet = told_unmet(delta.unmet.get(place, ()), delta.why.get(place, ()))
                decided[player] = (seq, unmet)
            waits = tuple(_player(world, number) for number in delta.waits)
        except (ValueError, IndexError) as error:
            raise ProtocolError(ErrorCode.STATE_MISMATCH, "a step by nobody") from error
        return cls(tuple(did), decided, waits)

    def tallied(self, seats: Iterable[messages.SeatInfo]) -> tuple[messages.SeatInfo, ...]:
        """The seats of the roster that came last, with what their participants did since then."""
        done = {player: applied for player, _, applied in self.did}
        return tuple(
            seat.model_copy(
                update={"acted": seat.acted + 1}
                if done[seat.player]
                else {"rejected": seat.rejected + 1}
            )
            if seat.player in done and seat.controller not in NOT_THEIRS
            else seat
            for seat in seats
        )


def _player(world: World, number: int) -> str:
    """The player of a seat's number; IndexError for one that is none."""
    if number < 0:
        raise IndexError(number)
    return world.players[number]


def told_unmet(words: Sequence[str], why: Sequence[messages.Why]) -> tuple[Unmet, ...]:
    """Reasons with their words; an older server gives the words alone."""
    if len(words) != len(why):
        return from_words(*words)
    return tuple(each.value(said) for each, said in zip(why, words, strict=True))
