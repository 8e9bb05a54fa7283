"""Transitions of a recording: state, request, result and next state, for analysis and learning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from robotouille.errors import UnknownNameError
from robotouille.replay.frame_schema import FrameSource
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State


@dataclass(frozen=True, slots=True)
class Transition:
    """One request of one seat.

    Attributes:
        step: Number of the step for which the request was made.
        state: The state before that step.
        seat: The seat's player.
        action: None if the seat decided to do nothing (then `valid`) or named no action.
        valid: True if the request was applied; otherwise `reasons` has the reasons.
        next_state: The state after the step; `state` if the request was not taken into a step.
        time: Seconds since the start of the game.
        thinking: Seconds that the seat took to decide; 0 if the request was not taken into a step.
        text: The request as text.
        seq: Sequence number; 0 for the actions of a substitute.
        basis: The step on whose state the choice was made, if recorded.
    """

    step: int
    state: State
    seat: str
    action: GroundAction | None
    valid: bool
    next_state: State
    time: float
    thinking: float = 0.0
    reasoning: str = ""
    text: str = ""
    reasons: tuple[str, ...] = ()
    seq: int = 0
    basis: int | None = None

    @property
    def staleness(self) -> int | None:
        """Number of steps between the state of the choice and `state`; None if unknown."""
        return None if self.basis is None else self.step - 1 - self.basis

    @property
    def reward(self) -> float:
        """Reward of the step; see `reward_of`."""
        return reward_of(self.state, self.next_state)


def reward_of(before: State, after: State) -> float:
    """Return 1 for a step that reaches the goal, in a shift the points, otherwise 0."""
    if before.orders is not None and after.orders is not None:
        return float(after.orders.score - before.orders.score)
    return float(after.goal_reached and not before.goal_reached)


def transitions(recording: FrameSource) -> Iterator[Transition]:
    """Yield all requests in order. Within a step, the order is that in which moves applied.

    Raises:
        RecordingError: The task has no such action.
    """
    step, state = 0, recording.world.initial
    for frame in recording.each_frame():
        if frame["kind"] == "notes":
            for note in frame["notes"]:
                if note["note"] == "rejected":
                    yield _rejected(step + 1, state, note)
        elif frame["kind"] == "step":
            step, before = frame["step"], state
            state = recording.take(before, frame).state
            yield from _taken(frame, recording.actions(frame), before, state)


def _taken(
    frame: Mapping[str, Any], actions: Sequence[GroundAction], before: State, after: State
) -> Iterator[Transition]:
    step, time, unmet = frame["step"], frame["t"] / 1000, frame.get("unmet", {})
    for place, (move, action) in enumerate(zip(frame["moves"], actions, strict=True)):
        reasons = tuple(unmet.get(str(place), ()))
        told = (step, before, move["player"], action, not reasons, after, time)
        yield Transition(
            *told,
            thinking=move["ms"] / 1000,
            reasoning=move.get("reasoning", ""),
            text=action.sentence,
            reasons=reasons,
            seq=move["seq"],
            basis=move.get("basis"),
        )
    for player, seq in frame.get("idle", ()):
        yield Transition(step, before, player, None, True, after, time, seq=seq)


def _rejected(step: int, state: State, note: Mapping[str, Any]) -> Transition:
    try:
        # Notes have the sentence of a rejected action, not its name and arguments, because a text
        # that names no action is rejected too.
        action = state.world.parse(state, note["player"], note["action"], valid=False)
    except UnknownNameError:
        action = None
    return Transition(
        step,
        state,
        note["player"],
        action,
        False,
        state,
        note["t"] / 1000,
        reasoning=note.get("reasoning", ""),
        text=note.get("text", note["action"]),
        reasons=tuple(note["reasons"]),
        seq=note["seq"],
        basis=note.get("basis"),
    )
