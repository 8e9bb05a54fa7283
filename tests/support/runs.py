"""Runs of the benchmark with few tasks, for tests of what happens in them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

from robotouille_evaluation.metrics.rows import PackId
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs import AgentSpec, Job, RunFolder, RunPlan

__all__ = ["agent", "small_pack", "started_run"]


@cache
def small_pack(*tasks: str) -> Pack:
    """The default instances of some tasks."""
    whole = build_own_pack()
    kept = tuple(i for i in whole.instances if i.task in tasks and i.kind == "default")
    return replace(whole, instances=kept)


def agent(kind: str, **more: str) -> AgentSpec:
    """One that is called what it is."""
    return AgentSpec.model_validate({"name": kind, "kind": kind, **more})


def started_run(path: Path, pack: Pack, *planned: Job) -> RunFolder:
    """The folder of a run of which nothing has been played."""
    id_ = PackId(name=pack.name, version=pack.version, digest=pack.digest)
    plan = RunPlan(name="r", pack=id_, pack_folder="", jobs=planned, software="0")
    return RunFolder.create(path, plan)
