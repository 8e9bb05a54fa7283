"""State of one seat in real time, without input or output.

The caller reports each step (`observe`), asks the model when the seat wants to (`wants_to_look`,
`look`), passes on the answer when it takes effect (`answer`), and sends what the seat chooses
(`choose`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from robotouille import State
from robotouille.planning.policies import Did
from robotouille_evaluation.agents.proposal import (
    MAX_REASONING,
    AgentObservation,
    Proposal,
    Strategy,
)
from robotouille_evaluation.realtime.observation import (
    LatePolicy,
    ObservedStep,
    digest,
    still_holds,
)
from robotouille_evaluation.realtime.thoughts import AnswerFate, begun_note, ended_note

MAX_EVENTS = 200
"""Actions of players that are kept for the digest."""


@dataclass(frozen=True, slots=True)
class SeatDecision:
    """Action of a model; an empty sentence does nothing. `basis` is the step that it answers."""

    action: str
    basis: int
    reasoning: str = ""
    valid: bool = True
    max_age: int | None = None
    """Most steps from the basis to the state in which the action is tried, if limited."""


class RealTimeSeat:
    """Seat of a model whose answers may come late.

    `notes` are notes of the topic `thinking` for the recording, which the caller removes. `done`
    means that the model has finished.

    Args:
        late: Rule for late answers.
        digest_tokens: Longest digest of changes above an observation; no digest if 0.
        max_age: Most steps between an observation and the answer to it. An older answer is dropped.
    """

    def __init__(
        self,
        player: str,
        strategy: Strategy,
        late: LatePolicy = LatePolicy.APPLY,
        digest_tokens: int = 0,
        max_age: int | None = None,
    ) -> None:
        self._player = player
        self._strategy = strategy
        self._late = late
        self._digest_tokens = digest_tokens
        self._max_age = max_age
        self._look: ObservedStep | None = None
        self._thinking = False
        self._plan: list[str] = []
        self._reasoning = ""
        self._fresh = False
        self._asked_at = -1
        self._events: list[str] = []
        self._feedback: list[str] = []
        self.done = False
        self.notes: list[str] = []

    @property
    def strategy(self) -> Strategy:
        """Strategy that asks the model."""
        return self._strategy

    @property
    def thinking(self) -> bool:
        """True while the model has been asked and has not answered."""
        return self._thinking

    @property
    def over(self) -> bool:
        """True if the seat will not act again."""
        return self.done and not self._plan and not self._thinking

    def observe(self, did: Did) -> None:
        """Observe what all players did in a step."""
        self._strategy.observe(did)
        for player, action, applied in did:
            rejected = "" if applied else " (refused)"
            who = "you" if player == self._player else player
            self._events.append(f"{who}: {action.sentence}{rejected}")
        # A model that never answers must not make the list grow without limit.
        del self._events[:-MAX_EVENTS]

    def wants_to_look(self, step: int) -> bool:
        """Return whether to ask the model now, which happens at most once per step."""
        free = not (self._thinking or self._plan or self.done)
        return free and step > self._asked_at

    def look(self, now: ObservedStep, state: State | None = None) -> AgentObservation:
        """Return the model's observation, and count the model as thinking from now on."""
        text = "\n\n".join(filter(None, [self._digest(now), now.text]))
        self._look, self._thinking, self._asked_at = now, True, now.step
        self._events.clear()
        self._feedback.clear()
        self.notes.append(begun_note(now.step))
        return AgentObservation(text, now.valid, self._player, state)

    def _digest(self, now: ObservedStep) -> str:
        then = self._look
        if then is None or not self._digest_tokens or then.step == now.step:
            return ""
        events = [*self._events, *self._feedback]
        return digest(then.text, now.text, now.step - then.step, events, self._digest_tokens)

    def answer(self, proposal: Proposal) -> None:
        """Let the model's answer take effect."""
        self._thinking = False
        self._plan = list(proposal.actions)
        self._reasoning = proposal.reasoning[:MAX_REASONING]
        self._fresh = True
        self.done = proposal.done
        if not self._plan and self._look is not None:
            self._end(self._look, AnswerFate.NONE)

    def choose(self, now: ObservedStep) -> SeatDecision | None:
        """Return the next action of the last answer; None without one, or if it is dropped."""
        if not self._plan or self._look is None:
            return None
        action, look = self._plan[0], self._look
        # Only the first action of an answer can be late; the others follow it.
        max_age = self._max_age if self._fresh and action else None
        if self._fresh:
            self._fresh = False
            old = max_age is not None and now.step - look.step > max_age
            if old or (action and not still_holds(self._late, action, look, now)):
                self._drop(look, action)
                return None
            self._end(look, AnswerFate.USED)
        self._plan.pop(0)
        reasoning, self._reasoning = self._reasoning, ""
        valid = not action or action in now.valid
        return SeatDecision(action, look.step, reasoning, valid, max_age)

    def rejected(self, action: str, reasons: Sequence[str] = ()) -> None:
        """Drop the rest of the plan after a rejected action, and keep the reasons as feedback."""
        self._plan.clear()
        why = f": {'; '.join(reasons)}" if reasons else ""
        self._feedback.append(f"your answer was refused, {action!r}{why}")

    def _drop(self, look: ObservedStep, action: str) -> None:
        self._plan.clear()
        self._reasoning, self.done = "", False
        self._feedback.append(f"your answer came too late and was dropped, {action!r}")
        self._end(look, AnswerFate.DROPPED, action)

    def _end(self, look: ObservedStep, fate: AnswerFate, action: str = "") -> None:
        self.notes.append(ended_note(look.step, fate, action))
