"""Variants: by chance a cut item reverts, for everybody alike, and recordings show it."""

from __future__ import annotations

import asyncio
import random
from pathlib import Path
from typing import Any

import pytest

from robotouille import World, load_task
from robotouille.errors import RecordingError, RobotouilleError
from robotouille.planning import Limits, StepsToGo
from robotouille.replay.container import magic, pack_frame
from robotouille.replay.export import json_lines
from robotouille.replay.recording import Recording, read_recording
from robotouille.replay.restore import restore
from robotouille_evaluation.metrics.rows import EpisodeRow
from robotouille_evaluation.metrics.trajectory import Trajectory
from robotouille_evaluation.models import Model, ScriptedModel, SeededAnswers
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.packs.published.checkout import read_checkout
from robotouille_evaluation.runs import AgentSpec, Job, jobs, play_job
from robotouille_evaluation.runs.variants import Reverting, chance
from tests.support.published import CHECKOUT, NEEDED
from tests.support.runs import agent, small_pack, started_run
from tests.support.samples import first_quickly

ALONE, TEAM = "synchronous/02_lettuce_sandwich", "multi_agent/01_lettuce_burger"


def pack() -> Pack:
    return small_pack(ALONE, TEAM)


MODEL = agent("model", strategy="react-last-reasoning-action", model="mock")


def played(
    folder: Path, kind: AgentSpec, task: str, seed: int, model: Model | None = None
) -> tuple[EpisodeRow, Recording]:
    planned = tuple(jobs(pack(), [kind], pack().instances, seeds=[seed], variant="stochastic"))
    (job,) = (each for each in planned if each.instance.startswith(task))
    run = started_run(folder, pack(), *planned)
    row = asyncio.run(play_job(job, "r", pack(), run, model, lambda: 0.0))
    assert row.error is None and row.recording is not None
    return row, read_recording(folder / row.recording)


def undone_in(recording: Recording) -> list[tuple[int, Any]]:
    return [(frame["step"], frame["undone"]) for frame in recording.steps if "undone" in frame]


@pytest.mark.parametrize("task", first_quickly([ALONE, TEAM]))
def test_a_planner_plans_anew_and_the_recording_verifies(tmp_path: Path, task: str) -> None:
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


@pytest.mark.parametrize("kind", ["random", "scripted", "model"])
def test_every_agent_can_play_it(tmp_path: Path, kind: str) -> None:
    spec = MODEL if kind == "model" else agent(kind)
    model = ScriptedModel(SeededAnswers(1)) if kind == "model" else None
    for seed in range(3):
        row, recording = played(tmp_path / str(seed), spec, ALONE, seed, model)
        assert recording.verify().identical
        assert recording.outcome is not None
        (seat,) = recording.outcome["seats"]
        assert seat["invalid"] == row.counts.invalid


def test_all_agents_meet_with_the_same_chance() -> None:
    world = World(pack().load(pack().instances[0]))
    state = world.initial
    for action in pack().plan(pack().instances[0], world):
        state = state.step(list(action)).state
        if state.holds("iscut", "lettuce1"):
            break
    times = []
    for _ in range(2):
        undone = chance("stochastic", world, "x")
        times.append([bool(undone(state)) for _ in range(60)])
    assert times[0] == times[1]
    assert sum(times[0]) == 1, "once in an episode"
    assert chance("", world, "x")(state) == ()


def test_a_draw_that_finds_nothing_is_followed_by_others() -> None:
    world = World(pack().load(pack().instances[0]))
    reverting = Reverting("iscut", random.Random(1), 1.0)
    assert not any(reverting(world.initial) for _ in range(5))


def test_a_domain_in_which_nothing_is_cut_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(load_task("synchronous/01"))
    monkeypatch.setattr("robotouille_evaluation.runs.variants.CUT", "issliced")
    with pytest.raises(RobotouilleError, match="issliced"):
        chance("stochastic", world, "x")


def test_what_chance_did_is_part_of_what_is_verified(tmp_path: Path) -> None:
    recording = next(
        found
        for seed in range(20)
        if undone_in(found := played(tmp_path / str(seed), agent("planner"), ALONE, seed)[1])
    )
    assert restore(recording, 0.0, 1.0).complete

    def changed(undone: list[list[str]] | None) -> Recording:
        stream = magic(recording.version)
        for frame in recording.each_frame():
            rest = dict(frame)
            if "undone" in frame:
                del rest["undone"]
                if undone is not None:
                    rest = {k: v for k, v in frame.items() if k != "undone"} | {"undone": undone}
            stream += pack_frame(rest, recording.version)
        return Recording(stream)

    assert "iscut(lettuce1)" in changed(None).verify().fault
    assert "lettuce9" in changed([["iscut", "lettuce9"]]).verify().fault
    with pytest.raises(RecordingError, match="lettuce9"):
        list(changed([["iscut", "lettuce9"]]).states())


def test_a_job_of_a_run_that_knew_no_variants_is_the_same_job() -> None:
    planned = next(jobs(pack(), [agent("random")], pack().instances))
    row = planned.model_dump()
    del row["variant"]
    assert Job.model_validate(row).id == planned.id
    assert planned.model_copy(update={"variant": "stochastic"}).id != planned.id


@NEEDED
def test_an_experiment_of_a_pack_is_played_as_it_says() -> None:
    published = read_checkout(CHECKOUT, seeds=()).pack
    found = {each.id: each for each in published.experiments}
    id_ = "ReAct/synchronous/last-reasoning-action-mpc"
    specs = [agent("model", strategy=name) for name in (id_, f"{id_}-stochastic")]
    assert found[specs[1].strategy].settings["game"]["stochastic"]
    named = [s.model_copy(update={"name": s.strategy}) for s in specs]
    instances = published.instances_of([published.tasks[0].name])[:1]
    planned = list(jobs(published, named, instances, seats=1, budget="published"))
    assert [job.variant for job in planned] == ["", "stochastic"]
    assert {j.variant for j in jobs(published, named, instances, budget="published",
                                    variant="stochastic")} == {"stochastic"}  # fmt: skip


def test_how_a_model_is_asked_is_no_part_of_a_job() -> None:
    patient = MODEL.model_copy(update={"timeout": 9.0, "attempts": 9, "prices": "1/2"})
    one, other = (next(jobs(pack(), [spec], pack().instances)) for spec in (MODEL, patient))
    assert one.id == other.id
