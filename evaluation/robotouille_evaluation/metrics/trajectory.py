"""Trajectories of episodes: states, joint actions, and every answer of each seat.

trajectory = Trajectory.recorded(read_recording("episode.rbt"))
trajectory = Trajectory.played(world, [{"robot1": "Move robot1 from table3 to table1"}])
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise
from typing import Any

from robotouille.episode import RejectionKind
from robotouille.errors import UnknownNameError
from robotouille.replay import Recording, rejection_kind
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.unmet import Unmet
from robotouille.world.world import State, World
from robotouille_evaluation.realtime.thoughts import Thought, thoughts


class AnswerVerdict(StrEnum):
    """Result of an answer."""

    APPLIED = "applied"
    INVALID = "invalid"
    """The answer names an inapplicable action of the task."""
    MALFORMED = "malformed"
    """The answer names no action of the task."""


@dataclass(frozen=True, slots=True)
class StepAnswer:
    """Answer of a seat after `step` steps. An applied answer with an empty text does nothing.

    Attributes:
        action: Action that the text names.
        reasons: Reasons for a rejection in words.
        unmet: Known unmet conditions.
        basis: Step that the answer is based on, if recorded.
    """

    step: int
    seat: str
    text: str
    verdict: AnswerVerdict = AnswerVerdict.APPLIED
    reasoning: str = ""
    reasons: tuple[str, ...] = ()
    unmet: tuple[Unmet, ...] = ()
    action: GroundAction | None = None
    basis: int | None = None

    @property
    def wrong(self) -> bool:
        """True if the answer was rejected."""
        return self.verdict is not AnswerVerdict.APPLIED


@dataclass(frozen=True, slots=True)
class Move:
    """One player's part of a joint action: applied, or rejected because of `unmet` conditions."""

    player: str
    action: GroundAction
    applied: bool = True
    unmet: tuple[Unmet, ...] = ()


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Course of one episode.

    Step `i`, from 0 on, leads from `states[i]` to `states[i + 1]` with `moves[i]`, in the order in
    which they applied. `thoughts` are the periods in which models thought in real time.
    """

    world: World
    states: tuple[State, ...]
    moves: tuple[tuple[Move, ...], ...]
    answers: tuple[StepAnswer, ...]
    thoughts: tuple[Thought, ...] = ()

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.moves)

    @property
    def goal_step(self) -> int | None:
        """Number of steps after which the goal first held; None if it never did."""
        return next((i for i, state in enumerate(self.states) if state.goal_reached), None)

    def each_step(self) -> Iterable[tuple[State, tuple[Move, ...], State]]:
        """Return each step as state, joint action and next state."""
        return (
            (before, joint, after)
            for (before, after), joint in zip(pairwise(self.states), self.moves, strict=True)
        )

    @classmethod
    def played(
        cls,
        world: World,
        joints: Iterable[Mapping[str, GroundAction | str | None]],
        answers: Sequence[StepAnswer] | None = None,
    ) -> Trajectory:
        """Return the trajectory of joint actions from the initial state.

        Args:
            joints: For each step, the actions or sentences of the players who do something.
            answers: Answers of the seats; if None, one for each move.

        Raises:
            UnknownNameError: A sentence is not a valid action, or a player is unknown.
        """
        states, steps, given = [world.initial], [], []
        for number, joint in enumerate(joints):
            wanted = {player: action for player, action in joint.items() if action is not None}
            result = states[-1].step(wanted)
            moves = tuple(
                Move(player, attempt.action, attempt.applied, attempt.unmet)
                for player, attempt in zip(wanted, result.attempts, strict=True)
            )
            states.append(result.state)
            steps.append(moves)
            given += [_answer(number, move) for move in moves]
        return cls(world, tuple(states), tuple(steps), tuple(given if answers is None else answers))

    @classmethod
    def recorded(cls, recording: Recording) -> Trajectory:
        """Return the trajectory of a recording, by simulating it again.

        Raises:
            RecordingError: A step has an action that the task does not have.
        """
        course = _RecordedCourse(recording)
        for frame in recording.each_frame():
            if frame["kind"] == "step":
                course.step(frame)
            elif frame["kind"] == "notes":
                for note in frame["notes"]:
                    if note["note"] == "rejected":
                        course.rejected(note)
        return cls(
            recording.world,
            tuple(course.states),
            tuple(course.moves),
            tuple(course.answers),
            thoughts(recording.notes()),
        )


def _answer(step: int, move: Move, text: str = "", reasoning: str = "") -> StepAnswer:
    verdict = AnswerVerdict.APPLIED if move.applied else AnswerVerdict.INVALID
    reasons = tuple(each.words for each in move.unmet)
    words = text or move.action.sentence
    return StepAnswer(
        step, move.player, words, verdict, reasoning, reasons, move.unmet, move.action
    )


class _RecordedCourse:
    """States, moves and answers of a recording's frames."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.states = [recording.world.initial]
        self.moves: list[tuple[Move, ...]] = []
        self.answers: list[StepAnswer] = []

    def step(self, frame: Mapping[str, Any]) -> None:
        """Add a step."""
        number = len(self.moves)
        result = self.recording.take(self.states[-1], dict(frame))
        moves = []
        for row, attempt in zip(frame["moves"], result.attempts, strict=True):
            move = Move(row["player"], attempt.action, attempt.applied, attempt.unmet)
            moves.append(move)
            answer = _answer(number, move, reasoning=row.get("reasoning", ""))
            self.answers.append(replace(answer, basis=row.get("basis")))
        # Number 0: the seat sent no request, so it gave no answer.
        for player, seq in frame.get("idle", ()):
            if seq > 0:
                self.answers.append(StepAnswer(number, str(player), ""))
        self.moves.append(tuple(moves))
        self.states.append(result.state)

    def rejected(self, note: Mapping[str, Any]) -> None:
        """Add a rejected request.

        A superseded request is not an answer of its own, and an unheard one was not evaluated.
        """
        kind = rejection_kind(note)
        if kind is RejectionKind.SUPERSEDED or not note.get("heard", True):
            return
        text = note.get("text") or note["action"]
        if kind is RejectionKind.MALFORMED:
            answer = StepAnswer(len(self.moves), note["player"], text, AnswerVerdict.MALFORMED)
        else:
            answer = rejected_answer(len(self.moves), note["player"], text, self.states[-1])
        self.answers.append(
            replace(
                answer,
                verdict=AnswerVerdict(kind.value),
                reasons=tuple(note["reasons"]),
                reasoning=note.get("reasoning", ""),
                basis=note.get("basis"),
            )
        )


def rejected_answer(step: int, seat: str, text: str, state: State) -> StepAnswer:
    """Return a rejected answer with the reasons in a state.

    It is invalid if the text names an action, even an applicable one (out of turn), and malformed
    otherwise.
    """
    try:
        action = state.world.parse(state, seat, text, valid=False)
    except UnknownNameError:
        return StepAnswer(step, seat, text, AnswerVerdict.MALFORMED)
    unmet = state.world.unmet(state, action)
    reasons = tuple(each.words for each in unmet)
    return StepAnswer(step, seat, text, AnswerVerdict.INVALID, "", reasons, unmet, action)
