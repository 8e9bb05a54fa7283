"""What it costs to think while the world goes on: staleness, late answers, steps that were lost."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import fmean

from robotouille.errors import UnknownNameError
from robotouille_evaluation.metrics.trajectory import Answer, Trajectory, Verdict

__all__ = ["LateAnswers", "late_answers", "lost_to_thinking", "staleness"]


def staleness(trajectory: Trajectory, seat: str = "") -> float | None:
    """The mean number of steps between what an answer was based on and the state in which it was
    applied; 0 where the world stood still. None if no answer of which the basis is recorded was.

    Args:
        seat: Whose; everybody's if empty.
    """
    steps = [
        answer.step - answer.basis
        for answer in trajectory.answers
        if answer.basis is not None and not answer.wrong and seat in ("", answer.seat)
    ]
    return fmean(steps) if steps else None


@dataclass(frozen=True, slots=True)
class LateAnswers:
    """Answers that came a step or more after what they were based on, and named an action that was
    valid there: `count` of them, of which `held` were applied all the same."""

    count: int
    held: int

    @property
    def share(self) -> float | None:
        """Those that held / all; None if there were none."""
        return self.held / self.count if self.count else None


def late_answers(trajectory: Trajectory) -> LateAnswers:
    """How many answers came late, and how many of them still held.

    What was not valid when the model looked is wrong, and not late: it does not count. An answer
    that was dropped did not hold, whether or not it would have applied.
    """
    dropped = [
        Answer(each.arrived or 0, each.seat, each.dropped, Verdict.INVALID, basis=each.basis)
        for each in trajectory.thoughts
        if each.dropped
    ]
    fates = [
        not answer.wrong
        for answer in (*trajectory.answers, *dropped)
        if answer.basis is not None
        and answer.basis < answer.step
        and _was_valid(trajectory, answer.basis, answer)
    ]
    return LateAnswers(len(fates), sum(fates))


def _was_valid(trajectory: Trajectory, basis: int, answer: Answer) -> bool:
    state = trajectory.states[basis]
    try:
        action = answer.action or state.world.parse(state, answer.seat, answer.text, valid=False)
    except UnknownNameError:
        return False
    return state.world.applicable(state, action)


def lost_to_thinking(trajectory: Trajectory) -> int | None:
    """Steps of players that passed while their model thought, without an action of theirs that was
    applied, and without their being busy; what a helper does is not lost. None where it is not
    recorded when models thought, or the world waited for them.
    """
    if not trajectory.thoughts:
        return None
    lost = set()
    for thought in trajectory.thoughts:
        end = trajectory.steps if thought.arrived is None else thought.arrived
        for step in range(thought.basis, min(end, trajectory.steps)):
            acted = any(m.player == thought.seat and m.applied for m in trajectory.moves[step])
            if not acted and not trajectory.states[step].busy_steps(thought.seat):
                lost.add((thought.seat, step))
    return len(lost)
