"""What happened in an episode, as values: states, joint actions, and every answer of each seat.

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

__all__ = ["Answer", "Move", "Trajectory", "Verdict", "refused"]


class Verdict(StrEnum):
    """What became of an answer."""

    APPLIED = "applied"
    INVALID = "invalid"
    """It names an action of the task that does not apply."""
    MALFORMED = "malformed"
    """No action of the task can be read from it."""


@dataclass(frozen=True, slots=True)
class Answer:
    """One answer of a seat, given after `step` steps. An empty text that was applied is nothing.

    `action` is what the text names, `reasons` say in words what speaks against it, `unmet` as
    values, as far as they are known. `basis` is the step on which it was based, if
    that is recorded.
    """

    step: int
    seat: str
    text: str
    verdict: Verdict = Verdict.APPLIED
    reasoning: str = ""
    reasons: tuple[str, ...] = ()
    unmet: tuple[Unmet, ...] = ()
    action: GroundAction | None = None
    basis: int | None = None

    @property
    def wrong(self) -> bool:
        """Whether it was refused."""
        return self.verdict is not Verdict.APPLIED


@dataclass(frozen=True, slots=True)
class Move:
    """One player's part in a joint action: applied, or refused for what was `unmet`."""

    player: str
    action: GroundAction
    applied: bool = True
    unmet: tuple[Unmet, ...] = ()


@dataclass(frozen=True, slots=True)
class Trajectory:
    """The course of one episode. Step `i`, from 0 on, leads from `states[i]` to `states[i + 1]` by
    `moves[i]`, in the order in which they applied. `thoughts` say when models were asked, where the
    world did not wait for them."""

    world: World
    states: tuple[State, ...]
    moves: tuple[tuple[Move, ...], ...]
    answers: tuple[Answer, ...]
    thoughts: tuple[Thought, ...] = ()

    @property
    def steps(self) -> int:
        """How many steps were taken."""
        return len(self.moves)

    @property
    def goal_step(self) -> int | None:
        """The number of steps after which the goal held first; None if it never did."""
        return next((i for i, state in enumerate(self.states) if state.goal_reached), None)

    def each_step(self) -> Iterable[tuple[State, tuple[Move, ...], State]]:
        """Every step as state, joint action, next state."""
        return (
            (before, joint, after)
            for (before, after), joint in zip(pairwise(self.states), self.moves, strict=True)
        )

    @classmethod
    def played(
        cls,
        world: World,
        joints: Iterable[Mapping[str, GroundAction | str | None]],
        answers: Sequence[Answer] | None = None,
    ) -> Trajectory:
        """The course of some joint actions from the initial state.

        Args:
            world: Of the task that is played.
            joints: For each step the action, or its sentence, of every player who does something.
            answers: What was answered on the way; if None, each move was an answer.

        Raises:
            UnknownNameError: A sentence is that of no valid action, or there is no such player.
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
        """The course that a recording holds, by re-simulation.

        Raises:
            RecordingError: A step has an action that the task has not.
        """
        course = _Course(recording)
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


def _answer(step: int, move: Move, text: str = "", reasoning: str = "") -> Answer:
    verdict = Verdict.APPLIED if move.applied else Verdict.INVALID
    reasons = tuple(each.words for each in move.unmet)
    words = text or move.action.sentence
    return Answer(step, move.player, words, verdict, reasoning, reasons, move.unmet, move.action)


class _Course:
    """Goes through the frames of a recording."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.states = [recording.world.initial]
        self.moves: list[tuple[Move, ...]] = []
        self.answers: list[Answer] = []

    def step(self, frame: Mapping[str, Any]) -> None:
        number = len(self.moves)
        result = self.recording.take(self.states[-1], dict(frame))
        moves = []
        for row, attempt in zip(frame["moves"], result.attempts, strict=True):
            move = Move(row["player"], attempt.action, attempt.applied, attempt.unmet)
            moves.append(move)
            answer = _answer(number, move, reasoning=row.get("reasoning", ""))
            self.answers.append(replace(answer, basis=row.get("basis")))
        for player, seq in frame.get("idle", ()):
            if seq > 0:
                self.answers.append(Answer(number, str(player), ""))
        self.moves.append(tuple(moves))
        self.states.append(result.state)

    def rejected(self, note: Mapping[str, Any]) -> None:
        """A request in vain: one that was superseded was valid, and is no answer of its own; and
        nobody has looked at one that was not heard."""
        kind = rejection_kind(note)
        if kind is RejectionKind.SUPERSEDED or not note.get("heard", True):
            return
        text = note.get("text") or note["action"]
        if kind is RejectionKind.MALFORMED:
            answer = Answer(len(self.moves), note["player"], text, Verdict.MALFORMED)
        else:
            answer = refused(len(self.moves), note["player"], text, self.states[-1])
        self.answers.append(
            replace(
                answer,
                verdict=Verdict(kind.value),
                reasons=tuple(note["reasons"]),
                reasoning=note.get("reasoning", ""),
                basis=note.get("basis"),
            )
        )


def refused(step: int, seat: str, text: str, state: State) -> Answer:
    """A refused answer, with what speaks against it in a state.

    It is invalid if the text names an action, also where that would apply (it was another's turn),
    and malformed if it names none.
    """
    try:
        action = state.world.parse(state, seat, text, valid=False)
    except UnknownNameError:
        return Answer(step, seat, text, Verdict.MALFORMED)
    unmet = state.world.unmet(state, action)
    reasons = tuple(each.words for each in unmet)
    return Answer(step, seat, text, Verdict.INVALID, "", reasons, unmet, action)
