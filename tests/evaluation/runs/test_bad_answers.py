"""Bad answers of models: rejected, counted and recorded, while the episode goes on."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille import World, load_task
from robotouille.replay.model_calls import model_calls
from robotouille.replay.recording import Recording, read_recording
from robotouille_evaluation.agents.making import make_strategy
from robotouille_evaluation.agents.proposal import AgentObservation, answer_all
from robotouille_evaluation.metrics.rows import Counts, ResultRow
from robotouille_evaluation.metrics.trajectory import AnswerVerdict, Trajectory
from robotouille_evaluation.models import (
    ModelError,
    ModelErrorKind,
    ModelRequest,
    ScriptedModel,
)
from robotouille_evaluation.models.scripted import Scripted
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs import AgentSpec, RunFolder, plan_jobs
from tests.support.runs import row_of, small_pack, started_run
from tests.support.samples import quick_sample

TASK = "synchronous/01_cheese_sandwich"
MEGABYTE = 1_000_000
FIRST = World(load_task(TASK)).initial.actions("robot1")[0].sentence
FLY = "Fly to the moon"

MALFORMED, INVALID = AnswerVerdict.MALFORMED, AnswerVerdict.INVALID
ANSWERS: dict[str, tuple[Scripted, AnswerVerdict]] = {
    "a megabyte of nothing": ("x" * MEGABYTE, MALFORMED),
    "a megabyte as action": ("Reasoning: so\nAction: " + "x" * MEGABYTE, MALFORMED),
    "a megabyte of reasoning": (f"Reasoning: {'y' * MEGABYTE}\nAction: {FLY}", MALFORMED),
    "a megabyte of actions": ("Action: up\n" * (MEGABYTE // 11), MALFORMED),
    "a megabyte of headings": ("Reasoning:\n" * (MEGABYTE // 11), MALFORMED),
    "no answer": (ModelError(ModelErrorKind.EMPTY, "no text"), MALFORMED),
    "blanks": (" \n\n ", MALFORMED),
    "another language": ("Begründung: gut.\nHandlung: Gehe zum Herd", MALFORMED),
    "another script": ("理由：好\n动作：去炉子", MALFORMED),
    "several actions, the last of which is none": (f"Action: {FIRST}\nAction: {FLY}", MALFORMED),
    "what was valid a step ago": (f"Reasoning: again\nAction: {FIRST}", INVALID),
    "control characters": ("Reasoning: \x00\x1b[2J\nAction: \u202e\x00", MALFORMED),
}


def pack() -> Pack:
    return small_pack(TASK)


class Stubborn:
    """Model that takes the first valid action and then repeats one text."""

    def __init__(self, answer: Scripted) -> None:
        self.answer = answer
        self.longest = 0
        self.asked = 0

    def __call__(self, request: ModelRequest) -> Scripted:
        self.asked += 1
        sent = sum(len(message.content) for message in request.messages)
        self.longest = max(self.longest, sent)
        return f"Reasoning: first\nAction: {FIRST}" if self.asked == 1 else self.answer


def in_process(folder: Path, answer: Stubborn, strategy: str) -> tuple[ResultRow, Recording]:
    spec = AgentSpec(name="m", kind="model", strategy=strategy, model="mock")
    (job,) = plan_jobs(pack(), [spec], pack().instances)
    model = ScriptedModel(answer)
    row = row_of(started_run(folder, pack(), job), pack(), job, model)
    assert row.recording is not None
    return row, read_recording(folder / row.recording)


@pytest.mark.parametrize("name", quick_sample(ANSWERS))
def test_bad_answers_in_a_run(tmp_path: Path, name: str) -> None:
    answer, verdict = ANSWERS[name]
    model = Stubborn(answer)
    row, recording = in_process(tmp_path, model, "react-full")
    assert row.error is None and row.outcome.ended_by == "feedback-limit"
    refused = model.asked - 1
    assert refused == 15
    assert row.counts == Counts(
        calls=16,
        invalid=refused if verdict is INVALID else 0,
        malformed=refused if verdict is MALFORMED else 0,
    )
    check(recording, refused, verdict)
    assert model.longest < 300_000, "a megabyte is not sent again"


async def test_long_answers_are_not_repeated_in_reflections() -> None:
    model = Stubborn("Reflection: " + "z" * MEGABYTE)
    complete = ScriptedModel(model).complete
    strategy = make_strategy(pack(), "reflexion", "synchronous")
    seen = AgentObservation(f"Valid Actions:\n{FIRST}", (FIRST,), "robot1")
    for _ in range(2):
        await answer_all(strategy.propose(seen), complete)
    assert strategy.retry()
    await answer_all(strategy.propose(seen), complete)
    assert model.asked == 1 + 5 + 1 + 5
    assert model.longest < 300_000


def check(recording: Recording, refused: int, verdict: AnswerVerdict) -> None:
    """Check the recorded answers with reasons, the counts, and the model calls."""
    assert recording.verify().identical
    assert recording.outcome is not None
    (seat,) = recording.outcome["seats"]
    assert seat["rejected"] == refused
    assert seat["invalid" if verdict is INVALID else "malformed"] == refused
    wrong = [answer for answer in Trajectory.recorded(recording).answers if answer.wrong]
    assert [answer.verdict for answer in wrong] == [verdict] * refused
    assert all(answer.reasons for answer in wrong)
    calls = list(model_calls(recording))
    assert len(calls) == refused + 1
    assert not any(call.missed for call in calls)


def test_calls_without_an_answer_are_counted(tmp_path: Path) -> None:
    fault = ModelError(ModelErrorKind.RATE_LIMITED, "slow down", attempts=6)
    row, _ = in_process(tmp_path, Stubborn(fault), "react-none")
    assert row.error is not None and row.outcome.ended_by == "error"
    assert (row.counts.calls, row.counts.retries) == (2, 5)


def test_long_error_leaves_a_row_that_can_be_read(tmp_path: Path) -> None:
    fault = ModelError(ModelErrorKind.REFUSED, "no " * MEGABYTE)
    row, _ = in_process(tmp_path, Stubborn(fault), "react-none")
    RunFolder(tmp_path).add(row)
    assert RunFolder(tmp_path).rows() == [row]
    assert row.error is not None and "no no" in row.error
