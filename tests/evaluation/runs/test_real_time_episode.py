"""Episodes in simulated real time: exact costs of thinking, and repeatable bytes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from robotouille import World, load_task
from robotouille.planning import solve
from robotouille.replay.recording import read_recording
from robotouille_evaluation.metrics import ResultRow, Trajectory
from robotouille_evaluation.models import (
    ModelError,
    ModelErrorKind,
    ModelRequest,
    ScriptedModel,
    SeededAnswers,
)
from robotouille_evaluation.models.model import valid_actions
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.realtime.thoughts import Thought
from robotouille_evaluation.runs import (
    AgentSpec,
    EpisodeJob,
    JobOptions,
    RealTime,
    RunFolder,
    plan_jobs,
)
from tests.support.runs import agent, row_of, small_pack, started_run
from tests.support.samples import quick_sample

ALONE, TEAM = "synchronous/01_cheese_sandwich", "multi_agent/01_lettuce_burger"
BEST = tuple(
    action.sentence
    for joint in solve(World(load_task(ALONE))).plan or ()
    for action in joint
)  # fmt: skip


def pack() -> Pack:
    return small_pack(ALONE, TEAM)


MODEL = agent("model", strategy="react-last-reasoning-action", model="mock")


def created(path: Path, planned: EpisodeJob) -> RunFolder:
    return started_run(path, pack(), planned)


def job(task: str, *, by: AgentSpec = MODEL, **time: Any) -> EpisodeJob:
    (found,) = [
        each
        for each in plan_jobs(
            pack(), [by], pack().instances, JobOptions(real_time=RealTime(**time))
        )
        if each.instance.startswith(task)
    ]
    return found


def play(path: Path, played: EpisodeJob, answer: Callable[[ModelRequest], Any]) -> ResultRow:
    folder = created(path, played)
    model = ScriptedModel(answer)
    return row_of(folder, pack(), played, model)


def course(path: Path, row: ResultRow) -> Trajectory:
    assert row.recording is not None
    recording = read_recording(path / row.recording)
    assert recording.verify().identical
    assert recording.header["rules"]["clock"] == "realtime"
    return Trajectory.recorded(recording)


def the_plan() -> Callable[[ModelRequest], str]:
    coming = iter(BEST)
    return lambda _: f"Reasoning: so.\nAction: {next(coming)}"


def first_valid(request: ModelRequest) -> str:
    return f"Reasoning: so.\nAction: {valid_actions(request)[0]}"


def test_thoughts_cost_steps(tmp_path: Path) -> None:
    """Eight actions at 300 ms with five steps per second lose two steps each: 24 in all."""
    played = job(ALONE, charge="declared:300", slack=2)
    row = play(tmp_path, played, the_plan())
    assert row.outcome.success
    assert (row.outcome.steps, row.budget.steps, row.budget.rule) == (24, 24, "own x 2")
    found = course(tmp_path, row)
    assert [a.basis for a in found.answers if a.text] == list(range(0, 24, 3))
    assert [a.step for a in found.answers if a.text] == list(range(2, 24, 3))
    assert found.thoughts == tuple(Thought("robot1", at, at + 2) for at in range(0, 24, 3))
    measures = row.measures
    assert (measures.staleness, measures.lost_to_thinking) == (2, 16)
    assert (measures.late_answers, measures.held_share) == (8, 1)
    assert row.clock == "realtime"
    assert str(row.real_time) == "5 steps/s, declared:300, apply"


@pytest.mark.parametrize(("max_age", "success"), [(1, False), (2, True)])
def test_answers_to_old_observations_are_dropped(
    tmp_path: Path, max_age: int, success: bool
) -> None:
    """Each answer comes two steps after its observation."""
    played = job(ALONE, charge="declared:300", slack=2, max_age=max_age)
    row = play(tmp_path, played, the_plan() if success else first_valid)
    assert row.outcome.success is success
    applied = [answer for answer in course(tmp_path, row).answers if answer.text]
    assert bool(applied) is success
    assert str(row.real_time) == f"5 steps/s, declared:300, apply up to {max_age} steps"


def test_charge_by_tokens(tmp_path: Path) -> None:
    """An answer has 9 to 11 words as tokens: 180 to 220 ms, which is one or two steps."""
    row = play(tmp_path, job(ALONE, charge="tokens:20", slack=3), the_plan())
    words = [len(f"Reasoning: so.\nAction: {action}".split()) for action in BEST]
    found = course(tmp_path, row)
    assert [(t.arrived or 0) - t.basis for t in found.thoughts] == [1 + (n > 10) for n in words]
    assert {1, 2} == {1 + (n > 10) for n in words}


def test_free_thoughts_lose_no_steps(tmp_path: Path) -> None:
    row = play(tmp_path, job(ALONE, charge="declared:0"), the_plan())
    assert (row.outcome.success, row.outcome.steps) == (True, 8)
    assert (row.measures.staleness, row.measures.lost_to_thinking) == (0, 0)
    assert (row.measures.late_answers, row.measures.held_share) == (0, None)


@pytest.mark.parametrize("late", ["apply", "revalidate", "drop"])
@pytest.mark.parametrize("task", quick_sample([ALONE, TEAM]))
def test_runs_repeat_byte_for_byte(tmp_path: Path, task: str, late: str) -> None:
    played = job(task, charge="tokens:15", late=late, helper="planner", digest_tokens=60)
    contents = []
    for name in ("one", "other"):
        row = play(tmp_path / name, played, SeededAnswers(3))
        assert row.error is None
        contents.append((row, (tmp_path / name / str(row.recording)).read_bytes()))
    assert contents[0] == contents[1]
    folder = created(tmp_path / "again", played)
    folder.calls(played, "robot1").parent.mkdir(parents=True, exist_ok=True)
    for kept in (tmp_path / "one").glob("calls/**/*.jsonl"):
        (folder.calls(played, "robot1").parent / kept.name).write_bytes(kept.read_bytes())
    resumed = row_of(folder, pack(), played)
    assert resumed == contents[0][0], "the journal answers all requests"


def test_helper_reaches_the_goal_alone(tmp_path: Path) -> None:
    played = job(ALONE, charge="declared:86400000", helper="planner")
    row = play(tmp_path, played, first_valid)
    assert (row.outcome.success, row.outcome.steps) == (True, 8)
    assert (row.counts.calls, row.measures.lost_to_thinking) == (1, 0), "paid for"
    found = course(tmp_path, row)
    assert found.thoughts == (Thought("robot1", 0),)
    assert [answer.basis for answer in found.answers] == [None] * 8


def test_pending_answers_are_counted_after_an_error(tmp_path: Path) -> None:
    """One model never answers; the other has acted and is asked again."""
    answered: list[str] = []

    def answer(request: ModelRequest) -> str | ModelError:
        if len(answered) == 2:
            return ModelError(ModelErrorKind.REFUSED, "the key is wrong")
        thought = "so. " if answered else "so, " * 1000
        answered.append(f"Reasoning: {thought}\nAction: {valid_actions(request)[0]}")
        return answered[-1]

    row = play(tmp_path, job(TEAM, charge="tokens:20"), answer)
    assert "the key is wrong" in str(row.error)
    assert row.usage.completion_tokens == sum(len(text.split()) for text in answered)
    assert row.counts.calls == 3, "the failed call counts, too"
    assert course(tmp_path, row).thoughts[0].arrived is None


def test_all_steps_are_lost_without_helper(tmp_path: Path) -> None:
    row = play(tmp_path, job(ALONE, charge="declared:86400000"), first_valid)
    assert (row.outcome.ended_by, row.outcome.steps) == ("step-limit", 12)
    assert (row.measures.lost_to_thinking, row.measures.staleness) == (12, None)


def test_helper_makes_late_answers_invalid(tmp_path: Path) -> None:
    """The model sends the cook to the cheese, where the helper has already been."""
    received: list[str] = []

    def answer(request: ModelRequest) -> str:
        received.append(request.messages[-1].content)
        return first_valid(request)

    played = job(ALONE, charge="declared:1000", helper="planner", digest_tokens=100)
    row = play(tmp_path, played, answer)
    assert row.counts.invalid >= 1
    assert (row.measures.late_answers, row.measures.held_share) == (1, 0)
    found = course(tmp_path, row)
    (refused,) = [answer for answer in found.answers if answer.wrong]
    assert (refused.basis, refused.step) == (0, 5)
    assert received[0].startswith("You are robot1.")
    assert received[1].startswith("Since you last looked 5 steps have passed.")
    assert "your answer was refused" in received[1]
    assert "* you: " in received[1]


def test_dropped_answers_are_recorded(tmp_path: Path) -> None:
    played = job(ALONE, charge="declared:400", helper="planner", late="drop")
    row = play(tmp_path, played, first_valid)
    found = course(tmp_path, row)
    assert [t.basis for t in found.thoughts] == [0, 2, 4, 6]
    assert [bool(t.dropped) for t in found.thoughts] == [True, True, True, False]
    assert row.outcome.success
    assert not any(answer.wrong for answer in found.answers)
    assert (row.measures.late_answers, row.measures.held_share) == (3, 0)
