"""The actions that one has sent: which have no answer yet, and what became of the rest."""

from __future__ import annotations

from robotouille.protocol import messages
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.unmet import Unmet, UnmetKind, only_words
from robotouille_client.sansio.game_events import ActResult

__all__ = ["REPEAT_SECONDS", "SLOW_DOWN_SECONDS", "ActionRequest", "SentActions", "wire_action"]

REPEAT_SECONDS = 5.0
"""After which an action without an answer is sent again; it acts once all the same."""
SLOW_DOWN_SECONDS = 0.25
"""After which an action that came too soon after many others is sent again."""


ActionRequest = GroundAction | messages.NamedAction | str | int | None
"""What one can ask to do: a ground action, a named one, its sentence, its place in the list of
valid actions, or None for nothing."""


class SentActions:
    """The actions of all of one's seats, numbered together: `seq` is the last number.

    Of each seat the last one is sent again until it is answered; those before it were replaced.
    """

    def __init__(self, seq: int) -> None:
        self.seq = seq
        self._undecided: dict[int, str] = {}
        self._unanswered: dict[str, messages.Act] = {}
        self._again_at: dict[str, float] = {}
        self._results: list[tuple[int, ActResult]] = []

    @property
    def unanswered(self) -> tuple[messages.Act, ...]:
        """Of each seat the last action, while it has no answer."""
        return tuple(self._unanswered.values())

    def next_seq(self) -> int:
        """A number that no action has had."""
        self.seq += 1
        return self.seq

    def add(self, seat: str, act: messages.Act, now: float) -> None:
        """An action of a seat is to be sent."""
        self._undecided[act.seq] = seat
        self._unanswered[seat] = act
        self._again_at[seat] = now + REPEAT_SECONDS

    def results(self) -> list[tuple[int, ActResult]]:
        """What became of actions since this was last asked, by their numbers."""
        results, self._results = self._results, []
        return results

    # Sending again

    def get_timer(self) -> float | None:
        """When `repeat` has something to send again; None while all is answered."""
        return min((self._again_at[seat] for seat in self._unanswered), default=None)

    def repeat(self, now: float, *, all_of_them: bool = False) -> list[messages.Act]:
        """Those whose time has come to be sent again, or all without an answer."""
        due = [seat for seat in self._unanswered if all_of_them or self._again_at[seat] <= now]
        for seat in due:
            self._again_at[seat] = now + REPEAT_SECONDS
        return [self._unanswered[seat] for seat in due]

    def slow_down(self, seq: int, now: float) -> bool:
        """An action was not heard, since there were too many: whether it is to be sent again."""
        for seat, act in self._unanswered.items():
            if act.seq == seq:
                self._again_at[seat] = now + SLOW_DOWN_SECONDS
                return True
        return False

    # Answers

    def settle(self, seat: str | None, seq: int, result: ActResult) -> None:
        """The fate of a seat's action is known; those of the seat before it were replaced."""
        for earlier in sorted(s for s, whose in self._undecided.items() if whose == seat):
            if earlier < seq:
                superseded = Unmet(UnmetKind.SUPERSEDED, f"superseded by action {seq}")
                self.resolve(earlier, ActResult.of(result.step, (superseded,)))
        self.resolve(seq, result)

    def settle_idle(self, step: int, turn: str | None) -> None:
        """A step was taken, in the turn of a seat if they take turns: decisions to do nothing are
        answered by the step in which nothing was done."""
        for seat, act in list(self._unanswered.items()):
            if act.action is None and turn in (None, seat):
                self.settle(seat, act.seq, ActResult.of(step, ()))

    def resolve(self, seq: int, result: ActResult) -> None:
        """The fate of one action is known."""
        seat = self._undecided.pop(seq, None)
        if seat is None:
            return
        last = self._unanswered.get(seat)
        if last is not None and last.seq == seq:
            del self._unanswered[seat]
        self._results.append((seq, result))

    def resolve_all(self, step: int, reason: str, code: str) -> None:
        """No more is to be heard of any."""
        for seq in sorted(self._undecided):
            self.resolve(seq, ActResult(False, step, only_words(reason), code))

    def refuse(self, seq: int, step: int, reason: str, code: str) -> None:
        """An action is not sent at all."""
        self._results.append((seq, ActResult(False, step, only_words(reason), code)))


def wire_action(action: ActionRequest) -> messages.NamedAction | str | int | None:
    """What is asked for, as `act` has it."""
    if isinstance(action, GroundAction):
        return messages.NamedAction(name=action.name, args=list(action.arguments))
    return action
