"""Instances of a pack as samples."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, get_args

from inspect_ai.dataset import MemoryDataset, Sample

from robotouille.errors import RobotouilleError, UnknownNameError, did_you_mean
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.packs.pack import InstanceKind, Pack
from robotouille_evaluation.packs.store import read_pack
from robotouille_evaluation.runs.jobs import AgentSpec, Job, jobs

__all__ = ["Words", "as_words", "load_pack", "samples"]

Words = str | int | Sequence[str | int]
"""Several words: a list, or one text with commas. Inspect's command reads `01` as a number."""


@lru_cache(maxsize=2)
def load_pack(folder: str) -> Pack:
    """The pack of a folder; ours if none is named."""
    return read_pack(Path(folder)) if folder else build_own_pack()


def as_words(words: Words) -> tuple[str, ...]:
    """Each word by itself."""
    parts = words.split(",") if isinstance(words, str) else words
    listed = [parts] if isinstance(parts, int) else parts
    return tuple(word for word in (str(part).strip() for part in listed) if word)


def samples(
    pack: Pack,
    dataset: str,
    *,
    tasks: Words = "",
    kinds: Words = "",
    budget: Literal["own", "published"] | None = None,
    seats: int | None = None,
) -> MemoryDataset:
    """The instances of a data set, each with all that tells it from others in its metadata.

    Args:
        tasks: Which, by name, number or dish; all if empty.
        kinds: Which of `default`, `free`, `noisy`; all if empty.
        budget: As for `runs.jobs`.
        seats: How many players, where a task leaves it open.

    Raises:
        RobotouilleError: There is no such data set, task, kind or budget, or nothing is left.
    """
    known: tuple[InstanceKind, ...] = get_args(InstanceKind)
    wanted = as_words(kinds) or known
    for what, names, of in (("data set", (dataset,), pack.datasets), ("kind", wanted, known)):
        for name in names:
            if name not in of:
                raise UnknownNameError(f"no {what} {name!r}{did_you_mean(name, of)}")
    meant = [word if "/" in word else f"{dataset}/{word}" for word in as_words(tasks)]
    chosen = [
        instance
        for instance in pack.instances_of(meant or None)
        if instance.kind in wanted and pack.task(instance.task).dataset == dataset
    ]
    if not chosen:
        raise RobotouilleError(f"the pack has no such instances of {dataset!r}")
    anybody = AgentSpec(name="anybody", kind="model")
    planned = jobs(pack, [anybody], chosen, seats=seats, budget=budget)
    return MemoryDataset([_sample(pack, job) for job in planned], name=dataset, location=pack.name)


def _sample(pack: Pack, job: Job) -> Sample:
    instance = pack.instance(job.instance)
    budget = pack.budget(instance, job.budget, seats=job.seats)
    best = instance.best(job.seats)
    metadata: dict[str, Any] = {
        "pack": {"name": pack.name, "version": pack.version, "digest": pack.digest},
        "task": instance.task,
        "instance": instance.id,
        "kind": instance.kind,
        "layout_seed": instance.seed,
        "seats": job.seats,
        "budget": {"rule": job.budget, "steps": budget.max_steps},
        "optimum": (
            {"steps": best.steps, "bound": best.bound, "proven": best.proven} if best else None
        ),
    }
    goal = pack.load(instance, seats=job.seats).goal_description
    target = f"The goal in at most {budget.max_steps} steps."
    return Sample(input=goal, target=target, id=instance.id, metadata=metadata)
