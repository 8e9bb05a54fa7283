"""How an episode came along: steps to go, repeated transitions, recovery after an error."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

from robotouille.planning import Limits, StepsLeft, StepsToGo
from robotouille.planning.steps_to_go import Range, quotient
from robotouille_evaluation.metrics.trajectory import Answer, Trajectory, Verdict

__all__ = ["Recovery", "recovery", "repeated_transitions", "steps_to_go", "steps_to_go_at_the_end"]


def steps_to_go_at_the_end(
    trajectory: Trajectory, distance: StepsToGo, limits: Limits, fewest: int | None = None
) -> Range | None:
    """Fewest steps from the last state to the goal / fewest from the first (paper, finding 3).

    0 is the goal, 1 no progress, more than 1 farther away than at first. Where the search's limits
    leave it open, a range; None if the goal is out of reach.

    Args:
        trajectory: The course of the episode.
        distance: Steps to go in its world.
        limits: Of each search.
        fewest: The steps from the first state, if they are proven.
    """
    first = _first(trajectory, distance, limits, fewest)
    return quotient(distance(trajectory.states[-1], limits), first)


def steps_to_go(
    trajectory: Trajectory, distance: StepsToGo, limits: Limits, fewest: int | None = None
) -> tuple[Range | None, ...]:
    """The same for every state of the run, from the first on: it should fall from 1 to 0."""
    first = _first(trajectory, distance, limits, fewest)
    found, before = [], None
    for state in trajectory.states:
        found.append(quotient(distance(state, limits, after=before), first))
        before = state
    return tuple(found)


def _first(
    trajectory: Trajectory, distance: StepsToGo, limits: Limits, fewest: int | None
) -> StepsLeft:
    if fewest is not None:
        return StepsLeft(fewest, fewest)
    return distance(trajectory.world.initial, limits)


def repeated_transitions(trajectory: Trajectory) -> int:
    """Steps that repeat an earlier one: same state, same joint action (paper, finding 5).

    States are equal if their facts and timers are, so waiting for something is no repetition. The
    number is that of all steps less that of different ones. Refused answers take no step and are
    counted by themselves.
    """
    seen = set()
    for before, joint, _ in trajectory.each_step():
        seen.add((before, tuple((m.player, m.action) for m in joint if m.applied)))
    return trajectory.steps - len(seen)


@dataclass(frozen=True, slots=True)
class Recovery:
    """What became of a seat's errors.

    A stumble is a run of refused answers of one seat without an applied one between them. It was
    `recovered` from if the seat's next answer applied; `answers` is how many wrong ones all
    stumbles took. It is `repeated` if the same seat failed with the same kind of action for the
    same predicate before, and had recovered then.
    """

    stumbles: int
    recovered: int
    repeated: int
    answers: int

    @property
    def rate(self) -> float | None:
        """Stumbles recovered from / stumbles; None if there were none."""
        return self.recovered / self.stumbles if self.stumbles else None


def recovery(trajectory: Trajectory) -> Recovery:
    """Whether seats got over their errors, and made them again (paper, appendix "Transition
    Failure Recovery Analysis", which counts by hand)."""
    stumbles = recovered = repeated = wrong = 0
    for seat in sorted({answer.seat for answer in trajectory.answers}):
        overcome: set[tuple[str, ...]] = set()
        own = [answer for answer in trajectory.answers if answer.seat == seat]
        runs = [(is_wrong, list(run)) for is_wrong, run in groupby(own, lambda a: a.wrong)]
        for number, (is_wrong, run) in enumerate(runs):
            if not is_wrong:
                continue
            mistakes = {mistake(answer) for answer in run}
            stumbles += 1
            wrong += len(run)
            repeated += bool(mistakes & overcome)
            if number + 1 < len(runs):
                recovered += 1
                overcome |= mistakes
    return Recovery(stumbles, recovered, repeated, wrong)


def mistake(answer: Answer) -> tuple[str, ...]:
    """What kind of mistake a refused answer is: the action's name and the predicates unmet."""
    if answer.verdict is Verdict.MALFORMED or answer.action is None:
        return (Verdict.MALFORMED.value,)
    return (answer.action.name, *sorted({unmet.predicate for unmet in answer.unmet}))
