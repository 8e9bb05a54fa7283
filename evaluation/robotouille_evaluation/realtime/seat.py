"""One seat in real time, without input or output: a slow model, and a fast helper.

The shell tells what was done in a step (`observe`), asks the model when the seat wants to look
(`wants_to_look`, `look`), hands the answer over when its time has come (`answer`), and does what
the seat chooses (`choose`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from robotouille import State
from robotouille.planning.policies import Did
from robotouille_evaluation.agents.proposal import MAX_REASONING, Observation, Proposal, Strategy
from robotouille_evaluation.realtime.changes import digest
from robotouille_evaluation.realtime.late import Late, Look, holds
from robotouille_evaluation.realtime.thoughts import Fate, begun_note, ended_note

__all__ = ["Choice", "RealTimeSeat"]

MAX_DEEDS = 200
"""That are remembered for the digest."""


@dataclass(frozen=True, slots=True)
class Choice:
    """An action of the model's, as a sentence (nothing if it is empty), the step on which it is
    based, and whether it is valid now."""

    action: str
    basis: int
    reasoning: str = ""
    valid: bool = True


class RealTimeSeat:
    """What a seat does with its model's answers.

    `notes` are for the recording, of the topic `thinking`; the shell takes them away. `done` says
    that the model wants no further turn.

    Args:
        late: Which late answers are acted upon.
        digest_tokens: How long the digest may be that goes before what the model is shown; none
            if 0.
    """

    def __init__(
        self, player: str, strategy: Strategy, late: Late = Late.APPLY, digest_tokens: int = 0
    ) -> None:
        self._player = player
        self._strategy = strategy
        self._late = late
        self._digest_tokens = digest_tokens
        self._look: Look | None = None
        self._thinking = False
        self._plan: list[str] = []
        self._reasoning = ""
        self._fresh = False
        self._asked_at = -1
        self._deeds: list[str] = []
        self._news: list[str] = []
        self.done = False
        self.notes: list[str] = []

    @property
    def strategy(self) -> Strategy:
        """How the model is asked."""
        return self._strategy

    @property
    def thinking(self) -> bool:
        """Whether the model has been asked, and its answer has not come."""
        return self._thinking

    @property
    def over(self) -> bool:
        """Whether there is nothing more to come of it."""
        return self.done and not self._plan and not self._thinking

    def observe(self, did: Did) -> None:
        """What everybody did in a step."""
        self._strategy.observe(did)
        for player, action, applied in did:
            refused = "" if applied else " (refused)"
            who = "you" if player == self._player else player
            self._deeds.append(f"{who}: {action.sentence}{refused}")
        del self._deeds[:-MAX_DEEDS]

    # Thinking

    def wants_to_look(self, step: int) -> bool:
        """Whether the model is to be asked now: once a step at most."""
        free = not (self._thinking or self._plan or self.done)
        return free and step > self._asked_at

    def look(self, now: Look, state: State | None = None) -> Observation:
        """What the model is shown; it thinks from now on."""
        text = "\n\n".join(filter(None, [self._told(now), now.text]))
        self._look, self._thinking, self._asked_at = now, True, now.step
        self._deeds.clear()
        self._news.clear()
        self.notes.append(begun_note(now.step))
        return Observation(text, now.valid, self._player, state)

    def _told(self, now: Look) -> str:
        then = self._look
        if then is None or not self._digest_tokens or then.step == now.step:
            return ""
        deeds = [*self._deeds, *self._news]
        return digest(then.text, now.text, now.step - then.step, deeds, self._digest_tokens)

    def answer(self, proposal: Proposal) -> None:
        """The model's answer has come, and counts from now on."""
        self._thinking = False
        self._plan = list(proposal.actions)
        self._reasoning = proposal.reasoning[:MAX_REASONING]
        self._fresh = True
        self.done = proposal.done
        if not self._plan and self._look is not None:
            self._end(self._look, Fate.NONE)

    # Acting

    def choose(self, now: Look) -> Choice | None:
        """What to do by the model's last answer; None where there is none, or it is dropped."""
        if not self._plan or self._look is None:
            return None
        action, look = self._plan[0], self._look
        if self._fresh:
            self._fresh = False
            if action and not holds(self._late, action, look, now):
                self._drop(look, action)
                return None
            self._end(look, Fate.USED)
        self._plan.pop(0)
        reasoning, self._reasoning = self._reasoning, ""
        return Choice(action, look.step, reasoning, not action or action in now.valid)

    def refused(self, action: str, reasons: Sequence[str] = ()) -> None:
        """What it chose was not valid any more: what was to follow is worth nothing."""
        self._plan.clear()
        why = f": {'; '.join(reasons)}" if reasons else ""
        self._news.append(f"your answer was refused, {action!r}{why}")

    def _drop(self, look: Look, action: str) -> None:
        self._plan.clear()
        self._reasoning, self.done = "", False
        self._news.append(f"your answer came too late and was dropped, {action!r}")
        self._end(look, Fate.DROPPED, action)

    def _end(self, look: Look, fate: Fate, action: str = "") -> None:
        self.notes.append(ended_note(look.step, fate, action))
