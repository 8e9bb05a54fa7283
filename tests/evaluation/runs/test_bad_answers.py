"""Whatever a model answers: it is refused, counted and recorded, and the episode goes on."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille import World, load_task
from robotouille.replay.model_calls import model_calls
from robotouille.replay.recording import Recording, read_recording
from robotouille_client import connect
from robotouille_evaluation.agents.asking import answer_all
from robotouille_evaluation.agents.making import make_strategy
from robotouille_evaluation.agents.network import NetworkAgent
from robotouille_evaluation.agents.proposal import Observation
from robotouille_evaluation.agents.teams.team import Each
from robotouille_evaluation.metrics.rows import Counts, EpisodeRow
from robotouille_evaluation.metrics.trajectory import Trajectory, Verdict
from robotouille_evaluation.models import (
    Completion,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    ScriptedModel,
)
from robotouille_evaluation.models.scripted import Scripted
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs import AgentSpec, jobs, play_job
from tests.support.runs import small_pack, started_run
from tests.support.samples import first_quickly
from tests.support.servers import serving
from tests.support.virtual_time import run

TASK = "synchronous/01_cheese_sandwich"
MEGABYTE = 1_000_000
FIRST = World(load_task(TASK)).initial.actions("robot1")[0].sentence
FLY = "Fly to the moon"

MALFORMED, INVALID = Verdict.MALFORMED, Verdict.INVALID
ANSWERS: dict[str, tuple[Scripted, Verdict]] = {
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
    """Takes the first valid action, and then says the same thing again and again."""

    def __init__(self, answer: Scripted) -> None:
        self.answer = answer
        self.longest = 0
        self.asked = 0

    def __call__(self, request: ModelRequest) -> Scripted:
        self.asked += 1
        sent = sum(len(message.content) for message in request.messages)
        self.longest = max(self.longest, sent)
        return f"Reasoning: first\nAction: {FIRST}" if self.asked == 1 else self.answer


def in_process(folder: Path, answer: Stubborn, strategy: str) -> tuple[EpisodeRow, Recording]:
    spec = AgentSpec(name="m", kind="model", strategy=strategy, model="mock")
    (job,) = jobs(pack(), [spec], pack().instances)
    model = ScriptedModel(answer)
    playing = play_job(job, "r", pack(), started_run(folder, pack(), job), model, lambda: 0.0)
    row = asyncio.run(playing)
    assert row.recording is not None
    return row, read_recording(folder / row.recording)


@pytest.mark.parametrize("name", first_quickly(ANSWERS, 3))
def test_in_process(tmp_path: Path, name: str) -> None:
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
    assert model.longest < 300_000, "no megabyte is sent again"


async def test_nor_is_it_in_a_reflection_or_below_what_is_read_next() -> None:
    model = Stubborn("Reflection: " + "z" * MEGABYTE)
    complete = ScriptedModel(model).complete
    strategy = make_strategy(pack(), "reflexion", "synchronous")
    seen = Observation(f"Valid Actions:\n{FIRST}", (FIRST,), "robot1")
    for _ in range(2):
        await answer_all(strategy.propose(seen), complete)
    assert strategy.retry()
    await answer_all(strategy.propose(seen), complete)
    assert model.asked == 1 + 5 + 1 + 5
    assert model.longest < 300_000


@pytest.mark.parametrize("name", first_quickly(ANSWERS, 3))
def test_over_the_network(tmp_path: Path, name: str) -> None:
    answer, verdict = ANSWERS[name]
    model = Stubborn(answer)

    async def complete(request: ModelRequest) -> Completion:
        await asyncio.sleep(1.0)  # of simulated time: models are slow
        try:
            return await ScriptedModel(model).complete(request)
        except ModelError as error:
            return Completion("", finish_reason=error.kind.value)

    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="m") as client:
            opened = await client.create(TASK, clock="turn", max_steps=6)
            game = await client.join(opened.code, view="text")
            strategy = make_strategy(pack(), "react-last-reasoning-action", "synchronous")
            alone = Each({"robot1": strategy}, {"robot1": complete})
            outcome = await NetworkAgent(game, alone).play()
            assert outcome["reason"] == "step_limit"

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    check(read_recording(file), model.asked - 1, verdict)


def check(recording: Recording, refused: int, verdict: Verdict) -> None:
    """Everything is there: answers with their reasons, counts, and what was sent and said."""
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
