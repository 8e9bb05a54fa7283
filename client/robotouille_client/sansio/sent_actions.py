"""Bookkeeping of sent actions: which are undecided, which to repeat, and the results."""

from __future__ import annotations

from dataclasses import replace
from typing import TypedDict

from robotouille.protocol import messages
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.unmet import Unmet, UnmetKind, only_words
from robotouille_client.sansio.game_events import ActResult

# Delay before an unanswered action is sent again. The server recognizes its sequence number, so it
# executes the action once.
REPEAT_SECONDS = 5.0
# Delay before an action that exceeded the rate limit is sent again.
SLOW_DOWN_SECONDS = 0.25


RequestedAction = GroundAction | messages.NamedAction | str | int | None
"""Requested action: a ground or named action, a sentence, a position in the list of valid actions,
or None to do nothing."""


class ActDetails(TypedDict, total=False):
    """Optional details of an action.

    Attributes:
        think_ms: Milliseconds of thought, for episodes in which thinking time is declared.
        basis: The step on which the choice is based, for the recording. Defaults to the current
            step; None leaves it open.
        max_age: Most steps from `basis` to the state in which the action is tried. An older action
            is rejected with `action/stale`. Servers without this rule reject the message.
        reasoning: Text for the recording that no player sees, of at most 8,000 characters.
        anticipates: True if the action may become valid through another action in the same step.
            Servers that do not support this reject an action that is not valid yet.
        waits: True if a decision to do nothing means waiting for a blocked station or a teammate.
            The recording does not count waiting as idle.
    """

    think_ms: int
    basis: int | None
    max_age: int | None
    reasoning: str | None
    anticipates: bool
    waits: bool


class SentActions:
    """The sent actions of all seats of a client, with one common sequence number `seq`.

    The last action of each seat is repeated until it is answered. Earlier actions of the seat
    are superseded by it, so they need no repetition.
    """

    def __init__(self, seq: int) -> None:
        self.seq = seq
        self._undecided: dict[int, str] = {}
        self._bases: dict[int, int | None] = {}
        self._unanswered: dict[str, messages.Act] = {}
        self._again_at: dict[str, float] = {}
        self._results: list[tuple[int, ActResult]] = []

    @property
    def unanswered(self) -> tuple[messages.Act, ...]:
        """The last action of each seat that has no answer."""
        return tuple(self._unanswered.values())

    def next_seq(self) -> int:
        """Return an unused sequence number."""
        self.seq += 1
        return self.seq

    def add(self, seat: str, act: messages.Act, now: float) -> None:
        """Track an action that is about to be sent."""
        self._undecided[act.seq] = seat
        self._bases[act.seq] = act.basis
        self._unanswered[seat] = act
        self._again_at[seat] = now + REPEAT_SECONDS

    def results(self) -> list[tuple[int, ActResult]]:
        """Return the sequence numbers and results decided since the last call."""
        results, self._results = self._results, []
        return results

    # Repetition

    def get_timer(self) -> float | None:
        """Return the time of the next repetition, or None if every action is answered."""
        return min((self._again_at[seat] for seat in self._unanswered), default=None)

    def repeat(self, now: float, *, every: bool = False) -> list[messages.Act]:
        """Return the actions to send again now; with `every`, all unanswered ones."""
        due = [seat for seat in self._unanswered if every or self._again_at[seat] <= now]
        for seat in due:
            self._again_at[seat] = now + REPEAT_SECONDS
        return [self._unanswered[seat] for seat in due]

    def slow_down(self, seq: int, now: float) -> bool:
        """Schedule an action that exceeded the rate limit; False if it is superseded."""
        for seat, act in self._unanswered.items():
            if act.seq == seq:
                self._again_at[seat] = now + SLOW_DOWN_SECONDS
                return True
        return False

    # Answers

    def settle(self, seat: str | None, seq: int, result: ActResult, *, aged: bool = True) -> None:
        """Record the result of a seat's action, and that earlier ones were superseded.

        Args:
            aged: True if the action was tried in the step of the result, so that its age is known.
        """
        # The server reports one action per seat and step, and not the actions that this one
        # replaced before the step was taken.
        for earlier in sorted(s for s, whose in self._undecided.items() if whose == seat):
            if earlier < seq:
                superseded = Unmet(UnmetKind.SUPERSEDED, f"superseded by action {seq}")
                self._resolve(earlier, ActResult.of(result.step, (superseded,)), None)
        # Another process that played these seats may have used the number for another seat.
        if self._undecided.get(seq) == seat:
            self._resolve(seq, result, result.step - 1 if aged else None)

    def settle_idle(self, step: int, turn: str | None) -> None:
        """Settle decisions to do nothing after a step: those of one seat (its turn) or of all."""
        # A delta lists actions only, so a step without an action of the seat is the answer.
        for seat, act in list(self._unanswered.items()):
            if act.action is None and turn in (None, seat):
                self.settle(seat, act.seq, ActResult.of(step, ()))

    def resolve(self, seq: int, result: ActResult) -> None:
        """Record a rejection on arrival, unless the action already has a result."""
        self._resolve(seq, result, result.step)

    def _resolve(self, seq: int, result: ActResult, tried_at: int | None) -> None:
        """Record the result of one action, which was tried in the state of a step."""
        # Results arrive twice when an action was repeated, or when a snapshot repeats them.
        seat = self._undecided.pop(seq, None)
        basis = self._bases.pop(seq, None)
        if seat is None:
            return
        last = self._unanswered.get(seat)
        if last is not None and last.seq == seq:
            del self._unanswered[seat]
        age = None if basis is None or tried_at is None else tried_at - basis
        self._results.append((seq, replace(result, age=age)))

    def resolve_all(self, step: int, reason: str, code: str) -> None:
        """Reject all undecided actions."""
        for seq in sorted(self._undecided):
            self._resolve(seq, ActResult(False, step, only_words(reason), code), None)

    def reject(self, seq: int, step: int, reason: str, code: str) -> None:
        """Reject an action without sending it."""
        self._results.append((seq, ActResult(False, step, only_words(reason), code)))


def wire_action(action: RequestedAction) -> messages.NamedAction | str | int | None:
    """Return the `action` field of an `act` message."""
    if isinstance(action, GroundAction):
        return messages.NamedAction(name=action.name, args=list(action.arguments))
    return action
