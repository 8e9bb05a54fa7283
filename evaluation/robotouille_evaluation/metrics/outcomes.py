"""Success, optimality, scores, wrong answers, tokens, cost and progress."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from statistics import fmean, median

from robotouille.planning import Limits, StepsLeft, StepsToGo
from robotouille.planning.steps_to_go import Range, quotient
from robotouille_evaluation.metrics.rows import ResultRow, ScoreRow
from robotouille_evaluation.metrics.trajectory import AnswerVerdict, StepAnswer, Trajectory


def success_within(trajectory: Trajectory, budget: int) -> bool:
    """Return whether the goal held after at most `budget` steps (paper, section 4.2.2)."""
    return trajectory.goal_step is not None and trajectory.goal_step <= budget


def succeeded(row: ResultRow) -> bool:
    """Return whether an episode reached the goal within its budget (paper, section 4.2.2).

    The paper's budget is 1.5 times the optimum; the row names the rule of its budget. An episode
    that ended with an error counts as failed. A shift has no goal (`with_goal`).
    """
    return row.outcome.success and row.outcome.steps <= row.budget.steps


def with_goal(rows: Iterable[ResultRow]) -> list[ResultRow]:
    """Return the episodes that are not shifts."""
    return [row for row in rows if not row.is_shift]


def success_rate(rows: Sequence[ResultRow]) -> float | None:
    """Return the share of successful episodes; None without goals (paper, table "successes")."""
    tried = with_goal(rows)
    return fmean(map(succeeded, tried)) if tried else None


def score(trajectory: Trajectory) -> ScoreRow | None:
    """Return the score of a shift; None for a task with a goal."""
    task, orders = trajectory.world.task, trajectory.states[-1].orders
    if task.problem.shift is None or orders is None:
        return None
    planner = task.problem.shift.planner.get(task.seats)
    return ScoreRow(
        points=orders.score, served=orders.served, expired=orders.expired, planner=planner
    )


def score_share(row: ResultRow) -> float | None:
    """Return the points of a shift / the points of planner bots in the same seats.

    Returns:
        None for tasks with a goal, and if the planner's points are unknown or not positive.
    """
    found = row.score
    if found is None or found.planner is None or found.planner <= 0:
        return None
    return found.points / found.planner


def optimality_rate(row: ResultRow) -> float | None:
    """Return steps taken / fewest steps of a success; 1 is best (paper, section 4.2.2, finding 2).

    Returns:
        None for failures, and if the optimum is not proven.
    """
    optimum = row.optimum
    if not succeeded(row) or not optimum.proven or not optimum.steps:
        return None
    return row.outcome.steps / optimum.steps


def is_optimal(row: ResultRow) -> bool | None:
    """Return whether a success took the fewest steps; None if `optimality_rate` is."""
    rate = optimality_rate(row)
    return None if rate is None else rate <= 1


def mean_steps(rows: Sequence[ResultRow]) -> float | None:
    """Return the mean number of steps of successes and failures (paper, table "ablations")."""
    return fmean(row.outcome.steps for row in rows) if rows else None


def invalid_rate(rows: Iterable[ResultRow]) -> float | None:
    """Return answers with an inapplicable action / model calls; None without calls.

    PlanBench and AgentBench report similar rates. The paper counts such answers among its action
    and transition failures.
    """
    return _per_call([(row.counts.invalid, row.counts.calls) for row in rows])


def malformed_rate(rows: Iterable[ResultRow]) -> float | None:
    """Return answers without an action of the task / model calls; None without calls.

    AgentBench calls this "invalid format".
    """
    return _per_call([(row.counts.malformed, row.counts.calls) for row in rows])


def _per_call(pairs: list[tuple[int, int]]) -> float | None:
    calls = sum(count for _, count in pairs)
    return sum(count for count, _ in pairs) / calls if calls else None


def tokens(rows: Iterable[ResultRow]) -> tuple[int, int]:
    """Return the tokens of all prompts and of all completions."""
    spent = [row.usage for row in rows]
    return sum(u.prompt_tokens for u in spent), sum(u.completion_tokens for u in spent)


def cost(rows: Iterable[ResultRow]) -> float | None:
    """Return the cost of all calls; None if one is unknown, or if there are no calls."""
    costs = [row.usage.cost for row in rows if row.counts.calls]
    known = [each for each in costs if each is not None]
    return sum(known) if known and len(known) == len(costs) else None


def cost_per_success(rows: Sequence[ResultRow]) -> float | None:
    """Return the cost of all episodes, failures included, / successes."""
    total, successes = cost(rows), sum(map(succeeded, rows))
    return total / successes if total is not None and successes else None


def seconds_per_call(rows: Iterable[ResultRow]) -> float | None:
    """Return the median over episodes of wall seconds / calls."""
    each = [row.seconds / row.counts.calls for row in rows if row.counts.calls]
    return median(each) if each else None


def steps_to_go_at_the_end(
    trajectory: Trajectory, distance: StepsToGo, limits: Limits, fewest: int | None = None
) -> Range | None:
    """Return fewest steps from the last state / fewest from the first (paper, finding 3).

    0 is the goal, 1 no progress, and more than 1 farther away than at first.

    Args:
        distance: Steps to go in the trajectory's world.
        limits: Limits of each search.
        fewest: Proven number of steps from the first state.

    Returns:
        A range if the limits end the search early; None if the goal is out of reach.
    """
    first = _first(trajectory, distance, limits, fewest)
    return quotient(distance(trajectory.states[-1], limits), first)


def steps_to_go(
    trajectory: Trajectory, distance: StepsToGo, limits: Limits, fewest: int | None = None
) -> tuple[Range | None, ...]:
    """Return the same for every state of the run; ideally it falls from 1 to 0."""
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
    """Return the steps that repeat an earlier state and joint action (paper, finding 5).

    States include timers, so waiting for something is not a repetition. They do not include the
    orders of a shift, in which the time passes, so no step would repeat another one. Rejected
    answers take no step and are counted separately.
    """
    seen = set()
    for before, joint, _ in trajectory.each_step():
        applied = tuple((m.player, m.action) for m in joint if m.applied)
        seen.add((before.facts, before.timers, applied))
    return trajectory.steps - len(seen)


@dataclass(frozen=True, slots=True)
class MistakeRecovery:
    """Counts of stumbles and recoveries.

    A stumble is a series of rejected answers of one seat. It was `recovered` from if the seat's
    next answer applied. It is `repeated` if the seat had recovered from the same mistake before.
    `answers` is the number of wrong answers in all stumbles.
    """

    stumbles: int
    recovered: int
    repeated: int
    answers: int

    @property
    def rate(self) -> float | None:
        """Share of stumbles recovered from; None without stumbles."""
        return self.recovered / self.stumbles if self.stumbles else None


def recovery(trajectory: Trajectory) -> MistakeRecovery:
    """Count how seats recovered from mistakes and repeated them.

    The paper's appendix "Transition Failure Recovery Analysis" counts by hand.
    """
    stumbles = recovered = repeated = wrong = 0
    for seat in sorted({answer.seat for answer in trajectory.answers}):
        overcome: set[tuple[str, ...]] = set()
        own = [answer for answer in trajectory.answers if answer.seat == seat]
        # A run of wrong answers is one stumble, however many answers it takes.
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
    return MistakeRecovery(stumbles, recovered, repeated, wrong)


def mistake(answer: StepAnswer) -> tuple[str, ...]:
    """Return the kind of a rejected answer's mistake: action name and unmet predicates."""
    if answer.verdict is AnswerVerdict.MALFORMED or answer.action is None:
        return (AnswerVerdict.MALFORMED.value,)
    return (answer.action.name, *sorted({unmet.predicate for unmet in answer.unmet}))
