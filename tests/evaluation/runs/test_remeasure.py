"""Optimality and steps to go that are added later are those of a run that measures them."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from robotouille.errors import RecordingError, RobotouilleError
from robotouille_evaluation.metrics.rows import Optimum, ResultRow
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs import JobOptions, RunContext, plan_jobs, play_job
from robotouille_evaluation.runs.remeasure import lacks_measures, remeasured
from tests.support.runs import agent, small_pack, started_run
from tests.support.samples import quick_sample

ALONE, TEAM = "synchronous/01_cheese_sandwich", "multi_agent/01_lettuce_burger"


def played(path: Path, pack: Pack, *, steps_to_go: bool) -> ResultRow:
    """Return the row of a random player, who does not reach the goal."""
    options = JobOptions(budget="own" if pack.instances[0].plans else "published")
    (job,) = plan_jobs(pack, [agent("random")], pack.instances, options)
    folder = started_run(path, pack, job)
    context = RunContext("r", pack, folder, lambda: 0.0, steps_to_go=steps_to_go)
    row = asyncio.run(play_job(job, context))
    assert not row.outcome.success
    return row


def without_plans(pack: Pack, budget: int) -> Pack:
    """Return the pack before its plans were found, with a budget for its task."""
    return replace(
        pack,
        tasks=tuple(replace(task, optimal=budget) for task in pack.tasks),
        instances=tuple(replace(instance, plans=()) for instance in pack.instances),
    )


@pytest.mark.parametrize("task", quick_sample([ALONE, TEAM]))
def test_measures_are_those_of_a_run_that_measures(tmp_path: Path, task: str) -> None:
    pack = small_pack(task)
    wanted = played(tmp_path / "a", pack, steps_to_go=True)
    later = played(tmp_path / "b", pack, steps_to_go=False)
    assert wanted.measures.to_go_least is not None and later.measures.to_go_least is None
    assert lacks_measures(later, pack)
    assert remeasured(later, pack, tmp_path / "b") == wanted
    assert not lacks_measures(wanted, pack)


def test_optimum_that_was_proven_after_the_run_is_added(tmp_path: Path) -> None:
    proven = small_pack(ALONE)
    unproven = without_plans(proven, budget=8)
    row = played(tmp_path, unproven, steps_to_go=True)
    assert row.optimum == Optimum()
    assert not lacks_measures(row, unproven)
    assert proven.digest != row.pack.digest and lacks_measures(row, proven)
    found = remeasured(row, proven, tmp_path)
    assert found.optimum == Optimum(steps=8, bound=8, proven=True)
    assert not lacks_measures(found, unproven), "a proof is never lost"
    assert remeasured(found, unproven, tmp_path).optimum == found.optimum
    assert found.pack == row.pack and found.budget == row.budget, "what was played stays the same"


def test_recording_of_another_task_is_refused(tmp_path: Path) -> None:
    pack = small_pack(ALONE)
    row = played(tmp_path, pack, steps_to_go=False)
    (instance,) = pack.instances
    other = replace(instance, problem=instance.problem.replace("Make a", "Prepare a"))
    assert other != instance
    with pytest.raises(RobotouilleError, match=r"the recorded task is not .* choose the pack"):
        remeasured(row, replace(pack, instances=(other,)), tmp_path)
    with pytest.raises(RecordingError, match="cannot be read"):
        remeasured(row, pack, tmp_path / "elsewhere")
    with pytest.raises(RobotouilleError, match="unknown instance"):
        lacks_measures(row, replace(pack, instances=()))
