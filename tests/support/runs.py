"""Benchmark runs with few tasks."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

from robotouille_evaluation.metrics.rows import PackId, ResultRow
from robotouille_evaluation.models import Model
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs import (
    AgentSpec,
    EpisodeJob,
    RunContext,
    RunFolder,
    RunPlan,
    play_job,
)

__all__ = ["agent", "row_of", "small_pack", "started_run"]


@cache
def small_pack(*tasks: str) -> Pack:
    """Return a pack with the default instances of some tasks."""
    whole = build_own_pack()
    kept = tuple(i for i in whole.instances if i.task in tasks and i.kind == "default")
    return replace(whole, instances=kept)


def agent(kind: str, **more: str) -> AgentSpec:
    """Return an agent that is named after its kind."""
    return AgentSpec.model_validate({"name": kind, "kind": kind, **more})


def started_run(path: Path, pack: Pack, *planned: EpisodeJob) -> RunFolder:
    """Return the folder of a run without results."""
    id_ = PackId(name=pack.name, version=pack.version, digest=pack.digest)
    plan = RunPlan(name="r", pack=id_, pack_folder="", jobs=planned, software="0")
    return RunFolder.create(path, plan)


def row_of(
    folder: RunFolder,
    pack: Pack,
    job: EpisodeJob,
    model: Model | None = None,
    *,
    clock: Callable[[], float] = lambda: 0.0,
) -> ResultRow:
    """Return the row of a job that is played now."""
    return asyncio.run(play_job(job, RunContext("r", pack, folder, clock), model))
