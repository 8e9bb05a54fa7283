"""Runs: each job has one row and a verifiable recording, whatever stops the run."""

from __future__ import annotations

import asyncio
import itertools
import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from robotouille.errors import FileError, RobotouilleError
from robotouille.planning.policies import PlannerOptions
from robotouille.replay.controllers import controllers
from robotouille.replay.recording import read_recording
from robotouille_evaluation.metrics.rows import PackId, ResultRow
from robotouille_evaluation.models import (
    Completion,
    Model,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    ScriptedModel,
    SeededAnswers,
    Usage,
)
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs import (
    AgentSpec,
    EpisodeJob,
    JobOptions,
    RealTime,
    RunFolder,
    RunPlan,
    Workers,
    plan_jobs,
    run_jobs,
)
from robotouille_evaluation.runs import job_agents as policies
from tests.support.runs import agent, row_of, small_pack, started_run
from tests.support.samples import quick_sample

TASKS = ("synchronous/01_cheese_sandwich", "multi_agent/01_lettuce_burger")


def pack() -> Pack:
    return small_pack(*TASKS)


MODEL = agent("model", strategy="react-last-reasoning-action", model="mock")


def created(path: Path, planned: tuple[EpisodeJob, ...]) -> RunFolder:
    return started_run(path, pack(), *planned)


def play(folder: RunFolder, job: EpisodeJob, model: Model | None = None) -> ResultRow:
    return row_of(folder, pack(), job, model, clock=itertools.count(0.0).__next__)


def planned(*agents: AgentSpec, budget: str = "own") -> tuple[EpisodeJob, ...]:
    return tuple(plan_jobs(pack(), agents, pack().instances, JobOptions(budget=budget)))  # type: ignore[arg-type]


def job_of(kind: AgentSpec, task: str) -> EpisodeJob:
    return next(job for job in planned(kind) if job.instance.startswith(task))


@pytest.mark.parametrize("task", quick_sample(TASKS))
@pytest.mark.parametrize("kind", ["planner", "random", "scripted"])
def test_row_and_recording_of_an_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, task: str
) -> None:
    monkeypatch.setattr(policies, "PlannerOptions", partial(PlannerOptions, expansions=50))
    job = job_of(agent(kind), task)
    folder = created(tmp_path, (job,))
    row = play(folder, job)
    assert row.error is None
    assert row.outcome.success == (kind != "random")
    assert row.recording is not None
    recording = read_recording(tmp_path / row.recording)
    assert recording.verify().identical
    assert recording.outcome is not None
    assert (recording.outcome["reason"] == "goal") == row.outcome.success
    assert set(controllers(recording)[1].values()) == {"bot"}
    if kind == "scripted" and row.seats == 1:  # In lockstep nobody steps onto what is just left.
        assert row.outcome.steps == row.optimum.steps


def test_answers_of_a_model_are_counted(tmp_path: Path) -> None:
    job = job_of(MODEL, TASKS[0])
    folder = created(tmp_path, (job,))
    row = play(folder, job, ScriptedModel(SeededAnswers(3)))
    assert row.counts.calls > 0
    assert row.usage.prompt_tokens > 1000
    assert row.strategy == "react-last-reasoning-action"
    assert row.recording is not None
    recording = read_recording(tmp_path / row.recording)
    assert controllers(recording)[1] == {"robot1": "model"}
    (seat,) = recording.outcome["seats"]
    assert (seat["invalid"], seat["malformed"]) == (row.counts.invalid, row.counts.malformed)
    assert row.counts.malformed > 0
    assert play(folder, job, None) == row.model_copy(update={"seconds": 1.0}), "no model is asked"


class Stopping:
    """Model that stops the run after a number of answers."""

    name = "mock"

    def __init__(self, answers: int) -> None:
        self.left, self.asked = answers, 0
        self._model = ScriptedModel(SeededAnswers(5))

    async def complete(self, request: ModelRequest) -> Completion:
        if self.left == 0:
            raise KeyboardInterrupt
        self.left -= 1
        self.asked += 1
        return await self._model.complete(request)


def test_killed_run_repeats_no_paid_call(tmp_path: Path) -> None:
    job = job_of(MODEL, TASKS[0])
    whole = Stopping(1000)
    wanted = play(created(tmp_path / "whole", (job,)), job, whole)
    folder, asked = created(tmp_path / "stopped", (job,)), 0
    for _ in range(100):
        model = Stopping(4)
        try:
            row = play(folder, job, model)
        except KeyboardInterrupt:
            asked += model.asked
            continue
        asked += model.asked
        break
    assert asked == whole.asked
    assert row.model_copy(update={"seconds": 0.0}) == wanted.model_copy(update={"seconds": 0.0})


def test_truncated_row_is_removed(tmp_path: Path) -> None:
    all_jobs = planned(agent("scripted"))
    folder = created(tmp_path, all_jobs)
    for job in all_jobs:
        folder.add(play(folder, job))
    whole = (tmp_path / "rows.jsonl").read_bytes()
    assert set(folder.finished()) == {job.id for job in all_jobs}
    (tmp_path / "rows.jsonl").write_bytes(whole[:-10])
    assert len(folder.finished()) == len(all_jobs) - 1
    folder.add(play(folder, all_jobs[-1]))
    assert len(folder.finished()) == len(all_jobs)
    with pytest.raises(RobotouilleError, match="resume"):
        created(tmp_path, all_jobs)


def test_reading_a_run_changes_nothing(tmp_path: Path) -> None:
    """The run may be in progress, and a truncated row may be one being written."""
    (job, *_) = all_jobs = planned(agent("scripted"))
    folder = created(tmp_path, all_jobs)
    row = play(folder, job)
    folder.add(row)
    rows = tmp_path / "rows.jsonl"
    whole = rows.read_bytes()
    rows.write_bytes(whole + whole[:40])
    assert folder.rows() == [row]
    assert rows.read_bytes() == whole + whole[:40]
    folder.add(row)
    assert rows.read_bytes() == whole * 2
    rows.write_bytes(whole[:-1])
    folder.add(row)
    assert rows.read_bytes() == whole * 2, "a row that lacks only its line feed counts"


def test_one_process_at_a_time_plays_a_run(tmp_path: Path) -> None:
    all_jobs = planned(agent("scripted"))
    created(tmp_path, all_jobs)

    async def nobody(job: EpisodeJob) -> Model:
        raise AssertionError

    def go_on() -> None:
        workers, one = Workers(), RunFolder(tmp_path)
        asyncio.run(run_jobs(one, pack(), (), workers, nobody, lambda *_: None))

    with RunFolder(tmp_path).playing():
        with pytest.raises(RobotouilleError, match="is being played by another process"):
            go_on()
    go_on()


def test_moved_run_finds_its_pack(tmp_path: Path) -> None:
    id_ = PackId(name=pack().name, version=pack().version, digest=pack().digest)
    for where, moved in (("run/pack", "moved/pack"), ("packs/mine", "packs/mine")):
        folder = str(tmp_path.resolve() / where)
        plan = RunPlan(name="r", pack=id_, pack_folder=folder, software="0")
        run = RunFolder.create(tmp_path / "run", plan)
        assert run.plan() == plan
        run.path.rename(tmp_path / "moved")
        found = RunFolder(tmp_path / "moved").plan()
        assert found.pack_folder == str(tmp_path.resolve() / moved)
        (tmp_path / "moved/run.json").unlink()


def test_one_of_two_runs_that_begin_at_the_same_time_gets_the_folder(tmp_path: Path) -> None:
    id_ = PackId(name=pack().name, version=pack().version, digest=pack().digest)
    first = RunPlan(name="first", pack=id_, pack_folder="", software="0")

    class Second(RunPlan):
        def model_dump_json(self, **options: Any) -> str:
            RunFolder.create(tmp_path, first)
            return super().model_dump_json(**options)

    second = Second(name="second", pack=id_, pack_folder="", software="0")
    with pytest.raises(RobotouilleError, match="already has a run"):
        RunFolder.create(tmp_path, second)
    assert RunFolder(tmp_path).plan().name == "first"


def test_folder_without_run(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="has no run"):
        RunFolder(tmp_path).plan()
    (tmp_path / "run.json").write_text('{"format": "x"}')
    with pytest.raises(FileError, match=r"run\.json"):
        RunFolder(tmp_path).plan()


def test_own_strategies_read_the_player_name(tmp_path: Path) -> None:
    """As over the network; published prompts do not contain the name."""
    received: list[str] = []

    def answer(request: ModelRequest) -> str:
        received.append(request.messages[-1].content)
        return "Reasoning: no.\nAction: Do nothing"

    job = job_of(MODEL, TASKS[1])
    play(created(tmp_path, (job,)), job, ScriptedModel(answer))
    assert {text.splitlines()[0] for text in received} == {"You are robot1.", "You are robot2."}


def test_rejected_plan_is_recorded_and_counted(tmp_path: Path) -> None:
    job = job_of(agent("model", strategy="io", model="mock"), TASKS[0])
    folder = created(tmp_path, (job,))
    text = "Plan:\nMove robot1 from table3 to table1\nStack bread2 on cheese1 at table1 with robot1"
    row = play(folder, job, ScriptedModel(lambda _: text))
    assert row.outcome.ended_by == "plan-refused"
    assert row.counts.invalid + row.counts.malformed == 1
    notes = read_recording(folder.recording(job)).notes()
    (refused,) = [note for note in notes if note["note"] == "rejected"]
    assert refused["reasons"]


def test_paid_calls_are_counted_after_an_error(tmp_path: Path) -> None:
    job = job_of(MODEL, TASKS[0])
    calls = itertools.count()

    class Failing:
        name = "failing"

        async def complete(self, request: ModelRequest) -> Completion:
            if next(calls) < 2:
                return Completion("Fly to the moon", Usage(10, 5))
            raise ModelError(ModelErrorKind.SERVER, "it is ill", usage=Usage(7, 0))

    row = play(created(tmp_path, (job,)), job, Failing())
    assert row.error
    assert (row.usage.prompt_tokens, row.usage.completion_tokens) == (27, 10)


def test_impossible_jobs_are_refused() -> None:
    with pytest.raises(RobotouilleError, match="so it plays alone"):
        planned(agent("model", strategy="reflexion", model="mock"))
    bare = replace(pack(), instances=tuple(replace(i, plans=()) for i in pack().instances[:1]))
    with pytest.raises(RobotouilleError, match="pack prove"):
        tuple(plan_jobs(bare, [agent("scripted")], bare.instances, JobOptions(budget="published")))
    moving = RealTime(charge="tokens:20", helper="script")
    with pytest.raises(RobotouilleError, match="--helper script needs a plan"):
        tuple(
            plan_jobs(
                bare, [MODEL], bare.instances, JobOptions(budget="published", real_time=moving)
            )
        )


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"control": "joint", "real_time": {"charge": "tokens:20"}}, "jobs[0]"),
        ({"control": "joint", "agent": {"name": "p", "kind": "planner"}}, "jobs[0]"),
        ({"seed": 10**30}, "jobs[0].seed"),
        ({"agent": {**MODEL.model_dump(), "timeout": float("nan")}}, "is not JSON"),
        ({"agent": {**MODEL.model_dump(), "attempts": 0}}, "jobs[0].agent.attempts"),
    ],
)
def test_invalid_run_plan(tmp_path: Path, change: dict[str, object], place: str) -> None:
    folder = created(tmp_path, tuple(plan_jobs(pack(), [MODEL], pack().instances[:1])))
    plan = json.loads((tmp_path / "run.json").read_text())
    plan["jobs"][0].update(change)
    (tmp_path / "run.json").write_text(json.dumps(plan))
    with pytest.raises(FileError, match=re.escape(f"run.json: {place}: ")) as caught:
        folder.plan()
    assert len(str(caught.value).splitlines()) == 1
