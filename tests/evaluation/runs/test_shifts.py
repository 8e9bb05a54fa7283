"""Episodes of shifts: planners earn the recorded points, and a shift lasts until its end."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille import World, load_task
from robotouille.planning.policies.shift_policy import play_shift
from robotouille.replay import Recording
from robotouille.replay.recording import read_recording
from robotouille_evaluation.metrics import ResultRow, score_share
from robotouille_evaluation.models import ScriptedModel, SeededAnswers
from robotouille_evaluation.packs.own import build_shift_pack
from robotouille_evaluation.runs import (
    AgentSpec,
    JobOptions,
    RealTime,
    plan_jobs,
)
from tests.support.runs import agent, row_of, started_run
from tests.support.samples import quick_sample

STAND = "shifts/02_burger_stand"
SHIFTS = [
    (task.name, seats)
    for task in build_shift_pack().tasks
    for seats in load_task(task.name).problem.seats or ()
]


def play(
    folder: Path, name: str, seats: int, agent: AgentSpec, real_time: RealTime | None = None
) -> tuple[ResultRow, Recording]:
    pack = build_shift_pack()
    options = JobOptions(seats=seats, real_time=real_time)
    (job,) = plan_jobs(pack, [agent], pack.instances_of([name]), options)
    run = started_run(folder, pack, job)
    model = ScriptedModel(SeededAnswers(3))
    row = row_of(run, pack, job, model)
    assert row.error is None
    assert row.recording is not None
    return row, read_recording(folder / row.recording)


@pytest.mark.parametrize(
    ("kind", "seats", "real_time"),
    quick_sample(
        [("random", 2, None), ("model", 1, None), ("model", 1, RealTime(charge="declared:500"))]
    ),
)
def test_score_of_a_row_is_that_of_its_recording(
    tmp_path: Path, kind: str, seats: int, real_time: RealTime | None
) -> None:
    player = agent(kind, strategy="react-none", model="mock")
    row, recording = play(tmp_path, STAND, seats, player, real_time)
    assert row.score is not None
    assert row.outcome.ended_by == "shift-over"
    assert recording.outcome["reason"] == "shift_over"
    assert row.score.model_dump(exclude={"planner"}) == recording.outcome["score"]
    assert row.measures.failure is None


def test_orders_expire_after_an_agent_has_given_up(tmp_path: Path) -> None:
    row, recording = play(tmp_path, STAND, 1, agent("model", strategy="io", model="mock"))
    assert row.outcome.ended_by in ("plan-exhausted", "plan-refused")
    assert row.outcome.steps <= 1
    assert recording.outcome["reason"] == "shift_over"
    assert row.score is not None
    assert row.score.points < 0 and row.score.expired > 5


@pytest.mark.slow
def test_planner_alone_has_the_whole_score(tmp_path: Path) -> None:
    row, recording = play(tmp_path, STAND, 1, agent("planner"))
    assert score_share(row) == 1
    assert recording.verify().identical


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seats"), quick_sample(sorted(SHIFTS, key=lambda s: s != (STAND, 1)), 0, 4)
)
def test_planner_bots_earn_the_points_in_the_file(name: str, seats: int) -> None:
    world = World(load_task(name, seats=seats))
    assert world.task.problem.shift is not None
    _, last = play_shift(world)
    assert last.orders is not None
    points = world.task.problem.shift.planner[seats]
    assert last.orders.score == points, "run: python tools/shift_scores.py"
