"""Variants: random reversals that are equal for all agents and recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robotouille import World
from robotouille.errors import RecordingError
from robotouille.planning import Limits, StepsToGo
from robotouille.replay.container import MAGIC, pack_frame
from robotouille.replay.controllers import json_lines
from robotouille.replay.recording import Recording, read_recording
from robotouille.replay.restore import restore
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.metrics.trajectory import Trajectory
from robotouille_evaluation.models import Model, ModelRequest, ScriptedModel
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.packs.published_checkout import read_checkout
from robotouille_evaluation.runs import (
    AgentSpec,
    JobOptions,
    plan_jobs,
)
from robotouille_evaluation.runs.chance import random_numbers, reversal_of
from robotouille_evaluation.runs.job_list import Variant
from tests.support.published import CHECKOUT, NEEDED, conversations, read
from tests.support.runs import agent, row_of, small_pack, started_run
from tests.support.samples import quick_sample

ALONE, TEAM = "synchronous/02_lettuce_sandwich", "multi_agent/01_lettuce_burger"


def pack() -> Pack:
    return small_pack(ALONE, TEAM)


MODEL = agent("model", strategy="react-last-reasoning-action", model="mock")


def played(
    folder: Path, kind: AgentSpec, task: str, seed: int, model: Model | None = None
) -> tuple[ResultRow, Recording]:
    planned = tuple(
        plan_jobs(pack(), [kind], pack().instances, JobOptions(seeds=[seed], variant="stochastic"))
    )
    (job,) = (each for each in planned if each.instance.startswith(task))
    run = started_run(folder, pack(), *planned)
    row = row_of(run, pack(), job, model)
    assert row.error is None and row.recording is not None
    return row, read_recording(folder / row.recording)


def undone_in(recording: Recording) -> list[tuple[int, Any]]:
    return [(frame["step"], frame["undone"]) for frame in recording.steps if "undone" in frame]


@pytest.mark.slow
@pytest.mark.parametrize("task", quick_sample([ALONE, TEAM]))
def test_planner_plans_again_after_a_reversal(tmp_path: Path, task: str) -> None:
    seen = 0
    for seed in range(4):
        row, recording = played(tmp_path / str(seed), agent("planner"), task, seed)
        assert recording.verify().identical and row.variant == "stochastic"
        happened = undone_in(recording)
        assert len(happened) <= 1
        states = dict(recording.states())
        assert Trajectory.recorded(recording).states == tuple(states.values())
        for step, atoms in happened:
            seen += 1
            assert atoms == [["iscut", "lettuce1"]]
            assert not states[step].holds("iscut", "lettuce1")
            left = StepsToGo(recording.world)(states[step], Limits(expansions=3000))
            assert left.bound > 0 and left.steps is not None
            if task == ALONE:  # No step is lost: whoever plans anew takes the shortest way.
                assert row.outcome.steps == min(step + left.steps, row.budget.steps)
            if step + left.steps + 2 <= row.budget.steps:
                assert row.outcome.success
            assert '"undone":[["iscut","lettuce1"]]' in "".join(json_lines(recording))
    assert seen


def test_reversals_depend_on_the_seed_only() -> None:
    world = World(pack().load(pack().instances[0]))
    state = world.initial
    for action in pack().plan(pack().instances[0], world):
        state = state.step(list(action)).state
        if state.holds("iscut", "lettuce1"):
            break

    def times(variant: Variant, kind: str) -> list[bool]:
        options = JobOptions(variant=variant)
        job = next(plan_jobs(pack(), [agent(kind)], pack().instances, options))
        undone = reversal_of(job, pack(), world)
        return [bool(undone(state)) for _ in range(60)]

    assert times("stochastic", "random") == times("stochastic", "planner")
    assert sum(times("stochastic", "random")) == 1, "one reversal per episode"
    assert times("stochastic-paper", "random").index(True) <= times("stochastic", "random").index(
        True
    ), "the paper's probability is larger"
    assert not any(times("", "random"))


def test_reversals_are_verified(tmp_path: Path) -> None:
    recording = next(
        found
        for seed in range(20)
        if undone_in(found := played(tmp_path / str(seed), agent("planner"), ALONE, seed)[1])
    )
    assert restore(recording, 0.0, 1.0).complete

    def changed(undone: list[list[str]] | None) -> Recording:
        stream = MAGIC
        for frame in recording.each_frame():
            rest = dict(frame)
            if "undone" in frame:
                del rest["undone"]
                if undone is not None:
                    rest = {k: v for k, v in frame.items() if k != "undone"} | {"undone": undone}
            stream += pack_frame(rest)
        return Recording(stream)

    assert "iscut(lettuce1)" in changed(None).verify().fault
    assert "lettuce9" in changed([["iscut", "lettuce9"]]).verify().fault
    with pytest.raises(RecordingError, match="lettuce9"):
        list(changed([["iscut", "lettuce9"]]).states())


@NEEDED
def test_experiment_chooses_its_variant() -> None:
    published = read_checkout(CHECKOUT, seeds=()).pack
    found = {each.id: each for each in published.experiments}
    id_ = "ReAct/synchronous/last-reasoning-action-mpc"
    specs = [agent("model", strategy=name) for name in (id_, f"{id_}-stochastic")]
    assert found[specs[1].strategy].settings["game"]["stochastic"]
    named = [s.model_copy(update={"name": s.strategy}) for s in specs]
    instances = published.instances_of([published.tasks[0].name])[:1]
    planned = list(plan_jobs(published, named, instances, JobOptions(seats=1, budget="published")))
    assert [job.variant for job in planned] == ["", "stochastic"]
    assert {j.variant for j in plan_jobs(published, named, instances, JobOptions(budget="published",
                                    variant="stochastic"))} == {"stochastic"}  # fmt: skip


@NEEDED
def test_experiments_with_and_without_examples_meet_the_same_reversals() -> None:
    pack = read_checkout(CHECKOUT, seeds=(42,)).pack
    instances = pack.instances_of(["synchronous/0_cheese_sandwich"], ["free"])
    ids = ("ReAct/ablations/original", "ReAct/synchronous/last-reasoning-action-mpc")
    agents = [agent("model", strategy=id_).model_copy(update={"name": id_}) for id_ in ids]
    options = JobOptions(budget="published", variant="stochastic")
    jobs = plan_jobs(pack, [agent("random"), *agents], instances, options)
    assert len({random_numbers(job, pack).random() for job in jobs}) == 1


@NEEDED
@pytest.mark.parametrize(
    "path",
    quick_sample([p for p in conversations() if "-stochastic_" in p.name], 1),
    ids=lambda path: path.name,
)
def test_stochastic_experiment_draws_the_published_random_numbers(
    tmp_path: Path, path: Path
) -> None:
    recorded = read(path)
    seed = recorded["seed"]
    pack = read_checkout(CHECKOUT, seeds=(seed,)).pack
    id_ = str(recorded["experiment"]).removeprefix("conf/experiments/").removesuffix(".yaml")
    spec = agent("model", strategy=id_, model="recorded")
    instance = pack.instance(f"{recorded['problem']}_{seed}")
    (job,) = plan_jobs(pack, [spec], [instance], JobOptions(budget="published"))
    asked = [event for event in recorded["events"] if event["event"] == "llm"]
    requests: list[list[str]] = []

    def answer(request: ModelRequest) -> str:
        requests.append([message.content for message in request.messages])
        return str(asked[len(requests) - 1]["answer"])

    run = started_run(tmp_path, pack, job)
    row = row_of(run, pack, job, ScriptedModel(answer))
    assert row.error is None
    texts = [message["content"] for message in recorded["messages"]]
    assert requests == [[texts[number] for number in event["messages"]] for event in asked]
    assert (row.outcome.ended_by, row.outcome.steps) == (
        recorded["result"]["ended_by"],
        recorded["result"]["steps"],
    )


def test_job_id_ignores_how_a_model_is_asked() -> None:
    patient = MODEL.model_copy(update={"timeout": 9.0, "attempts": 9, "prices": "1/2"})
    one, other = (next(plan_jobs(pack(), [spec], pack().instances)) for spec in (MODEL, patient))
    assert one.id == other.id
