"""Runs: every job has one row and a recording that verifies, whatever stops it meanwhile."""

from __future__ import annotations

import asyncio
import itertools
import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from robotouille.errors import FileError, RobotouilleError
from robotouille.planning.policies.planner_policy import PlannerPolicy
from robotouille.replay.controllers import controllers
from robotouille.replay.recording import read_recording
from robotouille_evaluation.agents import policies
from robotouille_evaluation.metrics.rows import EpisodeRow, PackId
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
    Job,
    RealTime,
    RunFolder,
    RunPlan,
    Workers,
    jobs,
    play_job,
    run_jobs,
)
from tests.support.runs import agent, small_pack, started_run

TASKS = ("synchronous/01_cheese_sandwich", "multi_agent/01_lettuce_burger")


def pack() -> Pack:
    return small_pack(*TASKS)


MODEL = agent("model", strategy="react-last-reasoning-action", model="mock")


def created(path: Path, planned: tuple[Job, ...]) -> RunFolder:
    return started_run(path, pack(), *planned)


def play(folder: RunFolder, job: Job, model: Model | None = None) -> EpisodeRow:
    clock = itertools.count().__next__
    return asyncio.run(play_job(job, "r", pack(), folder, model, lambda: float(clock())))


def planned(*agents: AgentSpec, budget: str = "own") -> tuple[Job, ...]:
    return tuple(jobs(pack(), agents, pack().instances, budget=budget))  # type: ignore[arg-type]


def job_of(kind: AgentSpec, task: str) -> Job:
    return next(job for job in planned(kind) if job.instance.startswith(task))


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("kind", ["planner", "random", "scripted"])
def test_an_episode_is_a_row_and_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, task: str
) -> None:
    monkeypatch.setattr(policies, "PlannerPolicy", partial(PlannerPolicy, expansions=50))
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


def test_a_model_plays_and_what_it_said_is_counted(tmp_path: Path) -> None:
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
    assert play(folder, job, None) == row.model_copy(update={"seconds": 1.0}), "nobody is asked"


def test_a_model_that_fails_ends_its_episode_and_no_other(tmp_path: Path) -> None:
    planned_jobs = planned(MODEL, agent("random"))
    folder = created(tmp_path, planned_jobs)
    refused = ModelError(ModelErrorKind.REFUSED, "the key is wrong")

    async def make(job: Job) -> Model:
        return ScriptedModel(lambda _: refused)

    asking = [job for job in planned_jobs if job.agent.kind == "model"]
    finished: list[EpisodeRow] = []
    running = run_jobs(folder, pack(), asking, Workers(), make, lambda _, row: finished.append(row))
    asyncio.run(running)
    assert [row.outcome.ended_by for row in finished] == ["error"] * len(asking)
    assert all("the key is wrong" in str(row.error) for row in finished)


def test_empty_answers_are_malformed_ones(tmp_path: Path) -> None:
    job = job_of(MODEL, TASKS[0])
    empty = ModelError(ModelErrorKind.EMPTY, "no text")
    row = play(created(tmp_path, (job,)), job, ScriptedModel(lambda _: empty))
    assert row.outcome.ended_by == "feedback-limit"
    assert row.counts.malformed == row.counts.calls == 15


class Stopping:
    """A model that is killed after so many answers."""

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


def test_no_paid_call_is_made_twice(tmp_path: Path) -> None:
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


def test_rows_survive_a_tear_and_another_run_is_refused(tmp_path: Path) -> None:
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
    """It may be going on: what looks torn is a row that is being written."""
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
    assert rows.read_bytes() == whole * 2, "a row that lacks its line feed only counts"


def test_a_run_is_played_by_one_process_at_a_time(tmp_path: Path) -> None:
    all_jobs = planned(agent("scripted"))
    created(tmp_path, all_jobs)

    async def nobody(job: Job) -> Model:
        raise AssertionError

    def go_on() -> None:
        workers, one = Workers(), RunFolder(tmp_path)
        asyncio.run(run_jobs(one, pack(), (), workers, nobody, lambda *_: None))

    with RunFolder(tmp_path).playing():
        with pytest.raises(RobotouilleError, match="is being played by another process"):
            go_on()
    go_on()


def test_a_run_that_was_moved_finds_the_pack_in_it(tmp_path: Path) -> None:
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


def test_a_folder_without_a_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="there is no run"):
        RunFolder(tmp_path).plan()
    (tmp_path / "run.json").write_text('{"format": "x"}')
    with pytest.raises(FileError, match=r"run\.json"):
        RunFolder(tmp_path).plan()


def test_ours_are_told_who_they_are(tmp_path: Path) -> None:
    """As over the network; what is published says nothing of it."""
    heard: list[str] = []

    def answer(request: ModelRequest) -> str:
        heard.append(request.messages[-1].content)
        return "Reasoning: no.\nAction: Do nothing"

    job = job_of(MODEL, TASKS[1])
    play(created(tmp_path, (job,)), job, ScriptedModel(answer))
    assert {text.splitlines()[0] for text in heard} == {"You are robot1.", "You are robot2."}


@pytest.mark.slow
def test_planners_of_a_team_count_on_each_other(tmp_path: Path) -> None:
    job = job_of(agent("planner"), TASKS[1])
    row = play(created(tmp_path, (job,)), job)
    assert row.outcome.success
    assert row.outcome.steps <= 1.05 * (row.optimum.steps or 0)
    assert row.counts.invalid == 0


def test_a_plan_that_is_refused_is_recorded_and_counted(tmp_path: Path) -> None:
    job = job_of(agent("model", strategy="io", model="mock"), TASKS[0])
    folder = created(tmp_path, (job,))
    text = "Plan:\nMove robot1 from table3 to table1\nStack bread2 on cheese1 at table1 with robot1"
    row = play(folder, job, ScriptedModel(lambda _: text))
    assert row.outcome.ended_by == "plan-refused"
    assert row.counts.invalid + row.counts.malformed == 1
    notes = read_recording(folder.recording(job)).notes()
    (refused,) = [note for note in notes if note["note"] == "rejected"]
    assert refused["reasons"]


def test_what_was_paid_for_is_counted_though_a_later_call_fails(tmp_path: Path) -> None:
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


def test_what_could_only_break_off_is_not_begun() -> None:
    with pytest.raises(RobotouilleError, match="begins anew after a failure, alone"):
        planned(agent("model", strategy="reflexion", model="mock"))
    bare = replace(pack(), instances=tuple(replace(i, plans=()) for i in pack().instances[:1]))
    with pytest.raises(RobotouilleError, match="pack prove"):
        tuple(jobs(bare, [agent("scripted")], bare.instances, budget="published"))
    moving = RealTime(charge="tokens:20", helper="script")
    with pytest.raises(RobotouilleError, match="that --helper script could"):
        tuple(jobs(bare, [MODEL], bare.instances, budget="published", real_time=moving))


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"control": "joint", "real_time": {"charge": "tokens:20"}}, "jobs.0"),
        ({"control": "joint", "agent": {"name": "p", "kind": "planner"}}, "jobs.0"),
        ({"seed": 10**30}, "jobs.0.seed"),
        ({"agent": {**MODEL.model_dump(), "timeout": float("nan")}}, "jobs.0.agent.timeout"),
        ({"agent": {**MODEL.model_dump(), "attempts": 0}}, "jobs.0.agent.attempts"),
    ],
)
def test_a_plan_that_was_edited_says_what_is_wrong_with_it(
    tmp_path: Path, change: dict[str, object], place: str
) -> None:
    folder = created(tmp_path, tuple(jobs(pack(), [MODEL], pack().instances[:1])))
    plan = json.loads((tmp_path / "run.json").read_text())
    plan["jobs"][0].update(change)
    (tmp_path / "run.json").write_text(json.dumps(plan))
    with pytest.raises(FileError, match=f"run.json: {place}: ") as caught:
        folder.plan()
    assert len(str(caught.value).splitlines()) == 1
