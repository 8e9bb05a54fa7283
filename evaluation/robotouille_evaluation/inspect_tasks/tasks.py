"""The three data sets as tasks of Inspect.

All take the same parameters (`-T NAME=VALUE`):

    pack         a pack's folder (`robotouille pack build`, `pack import`); ours if none
    strategy     one of ours, or the id of an experiment of the pack
    tasks        which tasks; all if none are named
    kinds        which instances: default, free, noisy
    budget       the limit of steps: own, published; own where a plan is known if none
    pictures     whether the transcript shows each state
    steps_to_go  whether it is measured how far from the goal an episode ended: slow
    out          where rows and recordings go, a folder for each evaluation

`multi_agent` takes `seats` besides: how many players, where a task leaves it open.
"""

from __future__ import annotations

from typing import Literal

from inspect_ai import Task, task

from robotouille.release import VERSION
from robotouille_evaluation.inspect_tasks.naming import of_distribution
from robotouille_evaluation.inspect_tasks.play import OUT, STRATEGY, play
from robotouille_evaluation.inspect_tasks.samples import Words, load_pack, samples
from robotouille_evaluation.inspect_tasks.scores import METRICS, STEPS_TO_GO_METRICS, outcome

__all__ = ["asynchronous", "multi_agent", "synchronous"]

KINDS = "free"


@task
@of_distribution
def synchronous(
    pack: str = "",
    strategy: str = STRATEGY,
    tasks: Words = "",
    kinds: Words = KINDS,
    budget: Literal["own", "published"] | None = None,
    pictures: bool = True,
    steps_to_go: bool = False,
    out: str = OUT,
) -> Task:
    """Tasks in which nothing takes time."""
    return _task("synchronous", pack, strategy, tasks, kinds, budget, pictures, steps_to_go, out)


@task
@of_distribution
def asynchronous(
    pack: str = "",
    strategy: str = STRATEGY,
    tasks: Words = "",
    kinds: Words = KINDS,
    budget: Literal["own", "published"] | None = None,
    pictures: bool = True,
    steps_to_go: bool = False,
    out: str = OUT,
) -> Task:
    """Tasks in which cooking goes on while a robot does something else."""
    return _task("asynchronous", pack, strategy, tasks, kinds, budget, pictures, steps_to_go, out)


@task
@of_distribution
def multi_agent(
    pack: str = "",
    strategy: str = STRATEGY,
    tasks: Words = "",
    kinds: Words = KINDS,
    budget: Literal["own", "published"] | None = None,
    pictures: bool = True,
    steps_to_go: bool = False,
    out: str = OUT,
    seats: int | None = None,
) -> Task:
    """Tasks for several robots, each with an agent of its own, in lockstep."""
    return _task(
        "multi_agent", pack, strategy, tasks, kinds, budget, pictures, steps_to_go, out, seats
    )


def _task(
    dataset: str,
    pack: str,
    strategy: str,
    tasks: Words,
    kinds: Words,
    budget: Literal["own", "published"] | None,
    pictures: bool,
    steps_to_go: bool,
    out: str,
    seats: int | None = None,
) -> Task:
    loaded = load_pack(pack)
    return Task(
        dataset=samples(loaded, dataset, tasks=tasks, kinds=kinds, budget=budget, seats=seats),
        solver=play(strategy, pack, pictures, steps_to_go, out),
        scorer=outcome(),
        metrics=METRICS | STEPS_TO_GO_METRICS if steps_to_go else None,
        # A model that cannot be asked ends its episode, not the others.
        fail_on_error=False,
        version=loaded.version,
        metadata={
            "pack": {"name": loaded.name, "version": loaded.version, "digest": loaded.digest},
            "strategy": strategy,
            "software": f"robotouille {VERSION}",
        },
    )
