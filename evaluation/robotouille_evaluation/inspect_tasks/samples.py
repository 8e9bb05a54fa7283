"""Instances of a pack as Inspect samples, and their scores."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import nan
from typing import Any, ParamSpec, TypeVar, get_args

from inspect_ai.dataset import MemoryDataset, Sample
from inspect_ai.scorer import Metric, Score, Scorer, Target, accuracy, mean, scorer, stderr
from inspect_ai.solver import TaskState

from robotouille.errors import RobotouilleError, UnknownNameError, did_you_mean
from robotouille.terminal import tell
from robotouille_evaluation.agents.making import PAPER_REACT
from robotouille_evaluation.metrics.outcomes import optimality_rate, score_share, succeeded
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.packs.built_in import find_pack
from robotouille_evaluation.packs.own import NAME, SHIFTS
from robotouille_evaluation.packs.pack import InstanceKind, Pack
from robotouille_evaluation.runs.budgets import GoalBudget, with_budget
from robotouille_evaluation.runs.job_list import AgentSpec, EpisodeJob, JobOptions, plan_jobs

OUT = "runs/inspect"
ROW = "robotouille_row"

P = ParamSpec("P")
R = TypeVar("R")

Words = str | int | Sequence[str | int]
"""Several words: a list, or a text with commas. Inspect's command reads `01` as a number."""


@dataclass(frozen=True, kw_only=True)
class TaskOptions:
    """Parameters of all Inspect tasks (`-T NAME=VALUE`).

    Attributes:
        pack: Folder of a pack; the built-in pack if empty.
        strategy: Built-in strategy, or the id of an experiment of the pack.
        tasks: Tasks by name, number or dish; all if empty.
        kinds: Kinds of instances (`default`, `free`, `noisy`); all if empty.
        budget: Rule of the step budget. If None, `own` if plans of all instances are known, and
            `published` if none is.
        pictures: Show each state in the transcript.
        steps_to_go: Search how far the goal was at the end, which is slow.
        out: Folder for rows and recordings, with a subfolder for each evaluation.
    """

    pack: str = ""
    strategy: str = PAPER_REACT
    tasks: Words = ""
    kinds: Words = "free"
    budget: GoalBudget | None = None
    pictures: bool = True
    steps_to_go: bool = False
    out: str = OUT


@dataclass(frozen=True, kw_only=True)
class TeamTaskOptions(TaskOptions):
    """Parameters of the task `multi_agent`.

    Attributes:
        seats: Number of players for tasks that allow several; the usual number if None.
    """

    seats: int | None = None


@dataclass(frozen=True, kw_only=True)
class ShiftTaskOptions(TeamTaskOptions):
    """Parameters of the task `shifts`.

    Attributes:
        pack: Folder of a pack; by default, the built-in pack of shifts.
    """

    pack: str = SHIFTS
    kinds: Words = "default"


def of_distribution(function: Callable[P, R]) -> Callable[P, R]:
    """Make Inspect register a function as `robotouille/NAME`.

    Inspect takes the first part from the function's package and looks it up among entry points.
    Users install and type the name of the distribution, which is not the package's.
    """
    function.__module__ = "robotouille"
    return function


@lru_cache(maxsize=2)
def load_pack(name: str) -> Pack:
    """Return the built-in pack with a name, by default `ours`, or the pack of a folder."""
    return find_pack(name or NAME)


def as_words(words: Words) -> tuple[str, ...]:
    """Return each of several words."""
    parts = words.split(",") if isinstance(words, str) else words
    listed = [parts] if isinstance(parts, int) else parts
    return tuple(word for word in (str(part).strip() for part in listed) if word)


def samples(pack: Pack, dataset: str, options: TaskOptions) -> MemoryDataset:
    """Return the chosen instances of a data set, described by their metadata.

    Raises:
        RobotouilleError: The data set, a task, kind or budget is unknown, or no instance is left.
    """
    known: tuple[InstanceKind, ...] = get_args(InstanceKind)
    wanted = as_words(options.kinds) or known
    for what, names, of in (("data set", (dataset,), pack.datasets), ("kind", wanted, known)):
        for name in names:
            if name not in of:
                raise UnknownNameError(f"unknown {what} {name!r}{did_you_mean(name, of)}")
    tasks = [word if "/" in word else f"{dataset}/{word}" for word in as_words(options.tasks)]
    chosen = [
        instance
        for instance in pack.instances_of(tasks or None)
        if instance.kind in wanted and pack.task(instance.task).dataset == dataset
    ]
    if not chosen:
        raise RobotouilleError(f"the pack has no such instances of {dataset!r}")
    seats = options.seats if isinstance(options, TeamTaskOptions) else None
    if seats is not None:
        pack.require_seats(chosen, seats)
    found = with_budget(pack, chosen, options.budget, seats)
    if found.left_out:
        tell(str(found), err=True)
    # The jobs check budgets and seats; Inspect chooses the model later.
    agent = AgentSpec(name="any", kind="model", strategy=options.strategy)
    jobs = plan_jobs(pack, [agent], found.instances, JobOptions(seats=seats, budget=found.rule))
    return MemoryDataset([_sample(pack, job) for job in jobs], name=dataset, location=pack.name)


def _sample(pack: Pack, job: EpisodeJob) -> Sample:
    instance = pack.instance(job.instance)
    budget = job.step_budget(pack)
    best = instance.best(job.seats)
    metadata: dict[str, Any] = {
        "pack": {"name": pack.name, "version": pack.version, "digest": pack.digest},
        "task": instance.task,
        "instance": instance.id,
        "kind": instance.kind,
        "layout_seed": instance.seed,
        "seats": job.seats,
        "variant": job.variant,
        "budget": {"rule": job.budget, "steps": budget.max_steps},
        "optimum": (
            {"steps": best.steps, "bound": best.bound, "proven": best.proven} if best else None
        ),
    }
    goal = pack.load(instance, seats=job.seats).goal_description
    target = (
        f"As many points as possible in {budget.max_steps} steps."
        if job.budget == "shift"
        else f"The goal in at most {budget.max_steps} steps."
    )
    return Sample(input=goal, target=target, id=instance.id, metadata=metadata)


METRICS: dict[str, list[Metric]] = {
    "success": [accuracy(), stderr()],
    "optimality_rate": [mean(), stderr()],
    "invalid": [mean()],
    "malformed": [mean()],
}
SHIFT_METRICS: dict[str, list[Metric]] = {
    "score_share": [mean(), stderr()],
    "points": [mean()],
    "invalid": [mean()],
    "malformed": [mean()],
}
STEPS_TO_GO_METRICS: dict[str, list[Metric]] = {
    "steps_to_go_least": [mean()],
    "steps_to_go_most": [mean()],
}


def keep_row(state: TaskState, row: ResultRow) -> None:
    """Store a row where the scorer and readers of the log find it."""
    state.store.set(ROW, row.model_dump(mode="json"))


@scorer(metrics=METRICS)
@of_distribution
def outcome() -> Scorer:
    """Return the scorer: success within the budget, and metrics of docs/metrics.md.

    A cancelled episode has no success. A cancelled shift has no share, and does not count.

    Undefined metrics, such as the optimality rate of a failure, are NaN. Inspect's metrics leave
    NaN out.
    """

    async def score(state: TaskState, target: Target) -> Score:
        raw = state.store.get(ROW)
        if raw is None:
            none = dict.fromkeys([*METRICS, *SHIFT_METRICS, *STEPS_TO_GO_METRICS], nan)
            why = "the episode was cancelled before it had a row"
            return Score(value={**none, "success": 0}, answer="broken off", explanation=why)
        row = ResultRow.model_validate(raw)
        return Score(
            value=_values(row),
            answer=row.outcome.ended_by,
            explanation=_explanation(row),
            metadata=raw,
        )

    return score


def _values(row: ResultRow) -> dict[str, str | int | float | bool | None]:
    found: dict[str, str | int | float | bool | None] = {
        "invalid": row.counts.invalid,
        "malformed": row.counts.malformed,
        "steps_to_go_least": row.measures.to_go_least,
        "steps_to_go_most": row.measures.to_go_most,
    }
    if row.score is None:
        found |= {"success": int(succeeded(row)), "optimality_rate": optimality_rate(row)}
    else:
        found |= {"score_share": score_share(row), "points": row.score.points}
    return {name: nan if value is None else value for name, value in found.items()}


def _explanation(row: ResultRow) -> str:
    best = row.optimum.steps
    optimum = (
        "" if best is None else f", {'optimum' if row.optimum.proven else 'best known'} {best}"
    )
    lines = [
        f"{row.outcome.ended_by} after {row.outcome.steps} of {row.budget.steps} steps{optimum}",
        f"{row.counts.calls} calls, {row.counts.invalid} invalid and "
        f"{row.counts.malformed} malformed answers",
        ""
        if row.score is None
        else f"{row.score.points} points, {row.score.served} served and "
        f"{row.score.expired} expired orders; planner bots earn {row.score.planner} points",
        f"error: {row.error}" if row.error else "",
    ]
    return "\n\n".join(filter(None, lines))
