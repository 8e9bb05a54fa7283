"""All metrics of one trajectory at once, as a row holds them."""

from __future__ import annotations

from robotouille import World
from robotouille.planning import Limits, StepsToGo
from robotouille_evaluation.metrics.asynchrony import asynchronous_first, time_shares
from robotouille_evaluation.metrics.failures import Failure, classify
from robotouille_evaluation.metrics.outcomes import success_within
from robotouille_evaluation.metrics.progress import recovery, steps_to_go_at_the_end
from robotouille_evaluation.metrics.real_time import late_answers, lost_to_thinking, staleness
from robotouille_evaluation.metrics.rows import FailureRow, Measures
from robotouille_evaluation.metrics.teams import blocking, contributions, overlap
from robotouille_evaluation.metrics.trajectory import Trajectory

__all__ = ["default_limits", "measure"]

ALONE, TOGETHER = Limits(expansions=2000), Limits(expansions=0)
FIRST = Limits(expansions=50)
"""For the first plan of a team, where none is known."""


def measure(
    trajectory: Trajectory,
    budget: int,
    *,
    distance: StepsToGo | None = None,
    fewest: int | None = None,
    limits: Limits | None = None,
) -> Measures:
    """What a row holds of a trajectory.

    Args:
        trajectory: The course of the episode.
        budget: The steps within which it should have reached the goal.
        distance: Steps to go in the trajectory's world; left out if None. One for all episodes of
            a task remembers what it has found.
        fewest: The steps from the first state to the goal, if they are proven.
        limits: Of each search for steps to go; if None, 2,000 expansions. For teams, whose take a
            hundred times as long, there is none then: the plan that is known (`StepsToGo.learn`),
            or else one that is found from the first state, is carried out from the last one.
    """
    shares, overcome = time_shares(trajectory), recovery(trajectory)
    late = late_answers(trajectory)
    found = Measures(
        asynchronous_first=asynchronous_first(trajectory),
        stumbles=overcome.stumbles,
        recovered=overcome.recovered,
        repeated_mistakes=overcome.repeated,
        waiting_share=shares.waiting if shares else None,
        idle_share=shares.idle if shares else None,
        contributions=contributions(trajectory) if len(trajectory.world.players) > 1 else {},
        blocked=blocking(trajectory),
        overlap=overlap(trajectory),
        staleness=staleness(trajectory),
        late_answers=late.count,
        held_share=late.share,
        lost_to_thinking=lost_to_thinking(trajectory),
        failure=_failure_row(classify(trajectory, budget)),
    )
    if distance is None:
        return found
    if limits is None:
        limits = default_limits(trajectory.world)
        if limits is TOGETHER and distance.known(trajectory.world.initial).steps is None:
            distance(trajectory.world.initial, FIRST)
    left = steps_to_go_at_the_end(trajectory, distance, limits, fewest)
    if left is None:
        return found.model_copy(update={"out_of_reach": not success_within(trajectory, budget)})
    return found.model_copy(update={"to_go_least": left.least, "to_go_most": left.most})


def default_limits(world: World) -> Limits:
    """Those of searches for steps to go where none are given."""
    return ALONE if len(world.players) == 1 else TOGETHER


def _failure_row(failure: Failure | None) -> FailureRow | None:
    if failure is None:
        return None
    return FailureRow(
        category=failure.category,
        subcategory=failure.subcategory.value,
        steps=failure.steps,
    )
