"""A recording as transitions: what each seat saw, asked for, got and thought; for data frames and
for learning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from robotouille.errors import UnknownNameError
from robotouille.replay.frame_schema import FrameSource
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

__all__ = ["Transition", "transitions"]


@dataclass(frozen=True, slots=True)
class Transition:
    """One thing that one seat asked for.

    `step` is the number of the step it was for, `state` the state before and `next_state` the one
    after it: the same one if it was taken into no step. `seat` is the player. `action` is None for
    a seat that chose to do nothing (`valid`), and for what was no action at all (not `valid`);
    `text` is what was asked for, in words. `valid` says that it was applied; if not, `reasons` say
    why. `time` is in seconds since the game began, `thinking` in seconds from being asked to
    answering, as the clock of the episode counts them (0 for what was taken into no step).
    `seq` is 0 for the actions of a bot that stood in for somebody. `basis` is the step whose state
    the choice was made on, if that is recorded.
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
        """Steps between the state that the choice was made on and `state`; None if unknown."""
        return None if self.basis is None else self.step - 1 - self.basis

    @property
    def reward(self) -> float:
        """1 for what was part of the step that reached the goal, else 0."""
        return float(self.next_state.goal_reached and not self.state.goal_reached)


def transitions(recording: FrameSource) -> Iterator[Transition]:
    """All that was asked for, in order; in a step in the order in which it applied.

    Raises:
        RecordingError: A step has an action that the task has not.
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
