"""Result rows of played jobs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from robotouille import World
from robotouille.planning import StepsToGo
from robotouille.replay.recording import Recording
from robotouille_evaluation.agents.proposal import Exchange
from robotouille_evaluation.metrics.measuring import measure
from robotouille_evaluation.metrics.outcomes import repeated_transitions
from robotouille_evaluation.metrics.rows import (
    BudgetRow,
    Counts,
    EpisodeMeasures,
    Optimum,
    PackId,
    RealTimeRow,
    TotalUsage,
)
from robotouille_evaluation.metrics.trajectory import Trajectory
from robotouille_evaluation.models import Usage
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs.episode_runner import RecordedRunner
from robotouille_evaluation.runs.job_list import EpisodeJob


def job_fields(job: EpisodeJob, pack: Pack) -> dict[str, Any]:
    """Return the fields of a row that are known before the episode is played."""
    instance = pack.instance(job.instance)
    best = instance.best(job.seats)
    known = Optimum(steps=best.steps, bound=best.bound, proven=best.proven) if best else Optimum()
    fields: dict[str, Any] = {
        "job": job.id,
        "pack": PackId(name=pack.name, version=pack.version, digest=pack.digest),
        "dataset": pack.task(instance.task).dataset,
        "task": instance.task,
        "instance": instance.id,
        "kind": instance.kind,
        "variant": job.variant,
        "seed": job.seed,
        "agent": job.agent.name if job.control == "each" else f"{job.agent.name}, {job.control}",
        "control": job.control,
        "strategy": job.agent.strategy,
        "model": job.agent.model,
        "clock": job.clock,
        "seats": job.seats,
        "optimum": known,
    }
    if job.real_time is not None:
        timing = job.real_time.model_dump(mode="json", exclude={"slack"})
        fields["real_time"] = RealTimeRow(**timing)
    return fields


def budget_row(job: EpisodeJob, limit: int) -> BudgetRow:
    """Return the budget of a job and its rule, such as `own x 2`."""
    rule = job.budget if job.slack == 1 else f"{job.budget} x {job.slack:g}"
    return BudgetRow(rule=rule, steps=limit)


def count_answers(exchanges: Sequence[Exchange], runners: Sequence[RecordedRunner]) -> Counts:
    """Return the counts of calls, retries and wrong answers of all trials."""
    answers = [exchange.completion for exchange in exchanges if exchange.completion is not None]
    return Counts(
        invalid=sum(runner.invalid for runner in runners),
        malformed=sum(runner.malformed for runner in runners),
        calls=len(answers),
        retries=sum(answer.attempts - 1 for answer in answers),
    )


def total_usage(usages: Iterable[Usage]) -> TotalUsage:
    """Return the tokens and cost of all calls."""
    total = sum(usages, Usage())
    return TotalUsage(
        prompt_tokens=total.prompt_tokens,
        completion_tokens=total.completion_tokens,
        cost=total.cost,
    )


def measure_recording(
    content: bytes, world: World, pack: Pack, job: EpisodeJob, limit: int, *, steps_to_go: bool
) -> tuple[EpisodeMeasures, int]:
    """Return the measures of a recorded trial and the number of its repeated transitions.

    Args:
        steps_to_go: Search how far the goal was at the end, which is slow.
    """
    recording = Recording(content)
    recording.world = world
    trajectory = Trajectory.recorded(recording)
    instance = pack.instance(job.instance)
    distance = StepsToGo(world) if steps_to_go else None
    if distance is not None and job.seats > 1 and instance.best(job.seats) is not None:
        # Searches for teams take a hundred times as long; the known plan is a bound without one.
        distance.learn(world.initial, pack.plan(instance, world))
    found = measure(trajectory, limit, distance=distance, fewest=instance.optimal(job.seats))
    return found, repeated_transitions(trajectory)
