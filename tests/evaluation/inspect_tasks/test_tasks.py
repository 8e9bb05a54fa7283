"""Benchmark under Inspect: messages, scores, recordings and transcripts."""

from __future__ import annotations

import asyncio
import importlib.util
import itertools
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from robotouille import World
from robotouille.errors import RobotouilleError
from robotouille.replay.recording import read_recording
from robotouille_evaluation.models import ModelRequest, ScriptedModel, SeededAnswers
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs import AgentSpec, RunContext, RunFolder, plan_jobs, play_job
from tests.support.samples import quick_sample

if TYPE_CHECKING:
    from inspect_ai import Task
    from inspect_ai.log import EvalLog, EvalSample
    from inspect_ai.model import ChatMessage

    from tests.evaluation.inspect_tasks.conftest import Evaluate

if importlib.util.find_spec("inspect_ai") is None:  # Not imported: that takes seconds.
    pytest.skip("needs inspect_ai", allow_module_level=True)

# The import of Inspect alone takes two seconds in each process.
pytestmark = pytest.mark.slow

ALONE, TEAM = "synchronous/01_cheese_sandwich", "multi_agent/01_lettuce_burger"
KEY = "sk-abcdefghijklmnop"


def pack() -> Pack:
    from robotouille_evaluation.inspect_tasks.samples import load_pack

    return load_pack("")


def task(tmp_path: Path, name: str = ALONE, **more: object) -> Task:
    from robotouille_evaluation.inspect_tasks import registry

    make: Callable[..., Task] = getattr(registry, name.partition("/")[0])
    settings = {"tasks": name, "kinds": "default", "pictures": False, "out": str(tmp_path / "out")}
    return make(**settings | more)


def plan() -> Iterator[str]:
    instance = pack().instance(f"{ALONE}/default")
    for step in pack().plan(instance, World(pack().load(instance))):
        for action in step:
            yield f"Reasoning: it is next.\nAction: {action.sentence}"


def of_plan() -> Callable[[object], str]:
    coming = plan()
    return lambda _: next(coming)


def only(log: EvalLog) -> EvalSample:
    """Return the only sample of an evaluation without errors."""
    from inspect_ai.log import resolve_sample_attachments

    assert log.status == "success", log.error
    assert log.samples is not None
    (sample,) = log.samples
    assert sample.error is None, sample.error.traceback
    return resolve_sample_attachments(sample, "full")


def value(sample: EvalSample) -> dict[str, float]:
    assert sample.scores is not None
    found = sample.scores["outcome"].value
    assert isinstance(found, dict)
    return {name: float(each) for name, each in found.items() if each is not None}


def received(sample: EvalSample) -> list[object]:
    return [event.data for event in sample.events if event.event == "info"]


def images(sample: EvalSample) -> list[str]:
    return [
        text for text in received(sample) if isinstance(text, str) and "data:image/jpeg" in text
    ]


def recording(sample: EvalSample) -> Path:
    return Path(sample.metadata["recording"])


def by_player(requests: list[list[tuple[str, str]]]) -> dict[str, list[list[tuple[str, str]]]]:
    """Group requests by player, because they arrive in any order."""
    found: dict[str, list[list[tuple[str, str]]]] = {}
    for request in requests:
        who = re.findall(r"You are (robot\d+)\.", request[-1][1])
        found.setdefault(who[0] if who else "", []).append(request)
    return found


@pytest.mark.parametrize(
    ("name", "strategy"),
    quick_sample(
        [
            (ALONE, "react-last-reasoning-action"),
            (ALONE, "react-full"),
            (ALONE, "io-cot"),
            (ALONE, "reflexion"),
            (TEAM, "react-last-reasoning-action"),
        ]
    ),
)
def test_messages_equal_those_of_runs(
    tmp_path: Path, evaluate: Evaluate, name: str, strategy: str
) -> None:
    ours: list[list[tuple[str, str]]] = []
    theirs: list[list[tuple[str, str]]] = []
    answers = SeededAnswers(5), SeededAnswers(5)

    def answer_ours(request: ModelRequest) -> str:
        ours.append([(said.role, said.content) for said in request.messages])
        return str(answers[0](request))

    def answer_theirs(messages: list[ChatMessage]) -> str:
        from robotouille_evaluation.models import Message

        theirs.append([(said.role, said.text) for said in messages])
        return str(answers[1](ModelRequest(tuple(Message(*said) for said in theirs[-1]))))

    agent = AgentSpec(name="ours", kind="model", strategy=strategy)
    (job,) = plan_jobs(pack(), [agent], [pack().instance(f"{name}/default")])
    clock = itertools.count().__next__
    row = asyncio.run(
        play_job(
            job,
            RunContext("ours", pack(), RunFolder(tmp_path), lambda: float(clock())),
            ScriptedModel(answer_ours),
        )
    )  # fmt: skip
    sample = only(evaluate(task(tmp_path, name, strategy=strategy), answer_theirs))
    assert len(ours) == row.counts.calls > 0
    assert by_player(theirs) == by_player(ours)
    assert value(sample)["invalid"] == row.counts.invalid
    assert value(sample)["malformed"] == row.counts.malformed


def test_success_is_scored_and_recorded(tmp_path: Path, evaluate: Evaluate) -> None:
    log = evaluate(task(tmp_path, steps_to_go=True), of_plan())
    sample = only(log)
    assert value(sample) == {
        "success": 1,
        "optimality_rate": 1,
        "invalid": 0,
        "malformed": 0,
        "steps_to_go_least": 0,
        "steps_to_go_most": 0,
    }
    assert log.results is not None
    metrics = {score.name: score.metrics for score in log.results.scores}
    assert metrics["success"]["accuracy"].value == 1
    assert metrics["optimality_rate"]["mean"].value == 1
    found = read_recording(recording(sample))
    assert found.verify().identical
    assert found.outcome is not None
    assert found.outcome["reason"] == "goal"
    (row,) = RunFolder(recording(sample).parents[1]).rows()
    assert row.outcome.success
    assert row.model == "mockllm/model"
    assert row.usage.prompt_tokens == 10 * row.counts.calls


def test_shifts_are_scored_by_points(tmp_path: Path, evaluate: Evaluate) -> None:
    log = evaluate(task(tmp_path, "shifts/02_burger_stand"), lambda _: "I do not know.")
    sample = only(log)
    (row,) = RunFolder(recording(sample).parents[1]).rows()
    assert row.score is not None and row.score.planner is not None
    found = value(sample)
    assert found["points"] == row.score.points < 0
    assert found["score_share"] == row.score.points / row.score.planner
    assert "success" not in found
    assert sample.target == "As many points as possible in 240 steps."


def test_metadata_of_samples(tmp_path: Path) -> None:
    made = task(tmp_path, kinds=["default", "noisy"])
    assert made.name == "robotouille/synchronous"
    assert len(made.dataset) == 6
    sample = made.dataset[0]
    assert sample.id == f"{ALONE}/default"
    assert sample.metadata is not None
    assert sample.metadata["pack"]["digest"] == pack().digest
    assert sample.metadata["budget"] == {"rule": "own", "steps": 12}
    assert sample.metadata["optimum"] == {"steps": 8, "bound": 8, "proven": True}
    assert "sandwich" in str(sample.input)


@pytest.mark.parametrize("tasks", [1, "01", "cheese_sandwich", ["01", 1], "synchronous/01"])
def test_names_of_tasks(tmp_path: Path, tasks: object) -> None:
    assert [sample.id for sample in task(tmp_path, tasks=tasks).dataset] == [f"{ALONE}/default"]


@pytest.mark.parametrize(
    "wrong",
    [
        {"tasks": "synchronous/01_cheese_sandwhich"},
        {"kinds": "noisey"},
        {"kinds": "noisy", "tasks": TEAM},
        {"strategy": "react-everything"},
        {"pack": "/nowhere"},
    ],
)
def test_unknown_names_are_errors(tmp_path: Path, wrong: dict[str, str]) -> None:
    from inspect_ai._util.error import PrerequisiteError

    with pytest.raises(RobotouilleError) as caught:
        task(tmp_path, **wrong)
    # Inspect prints errors of this kind in a line, and others with a traceback.
    assert isinstance(caught.value, PrerequisiteError)
    assert caught.value.message and "\n" not in str(caught.value)


def test_states_are_shown_and_not_sent(tmp_path: Path, evaluate: Evaluate) -> None:
    pytest.importorskip("pygame")
    sent: list[str] = []
    answer = of_plan()

    def listen(messages: list[ChatMessage]) -> str:
        sent.append(json.dumps([message.model_dump(mode="json") for message in messages]))
        return answer(messages)

    sample = only(evaluate(task(tmp_path, pictures=True), listen))
    assert len(images(sample)) == len(sent) + 1
    assert "goal is reached" in images(sample)[-1]
    assert "data:image" not in "".join(sent)


FAR = "Pick up cheese1 at table1 with robot1"
"""Action of the task that needs the robot elsewhere."""


def test_rejected_answers_are_in_the_transcript(tmp_path: Path, evaluate: Evaluate) -> None:
    answer = of_plan()
    first = iter([f"Reasoning: up!\nAction: {FAR}", "no"])
    sample = only(evaluate(task(tmp_path), lambda asked: next(first, None) or answer(asked)))
    assert (value(sample)["invalid"], value(sample)["malformed"]) == (1, 1)
    refused = [data for data in received(sample) if isinstance(data, dict)]
    assert [data["rejected"] for data in refused] == ["invalid", "no-action"]


def test_inspect_limits_end_and_score_an_episode(tmp_path: Path, evaluate: Evaluate) -> None:
    sample = only(evaluate(task(tmp_path), of_plan(), token_limit=40))
    assert sample.limit is not None
    assert sample.limit.type == "token"
    assert value(sample)["success"] == 0
    assert read_recording(recording(sample)).verify().identical


@pytest.mark.filterwarnings("ignore:The 'initial' parameter:DeprecationWarning")
async def test_cancelled_episodes_are_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from inspect_ai.model import ModelName, ModelOutput, ModelUsage, get_model
    from inspect_ai.solver import TaskState, generate

    made = task(tmp_path)
    answer, asked, silent = of_plan(), itertools.count(1), asyncio.Event()

    async def answer_thrice(*_: object) -> ModelOutput:
        if next(asked) > 3:
            silent.set()
            await asyncio.Event().wait()
        said = ModelOutput.from_content("mockllm", answer(None))
        said.usage = ModelUsage()
        return said

    model = get_model("mockllm/model", custom_outputs=answer_thrice)
    monkeypatch.setattr("robotouille_evaluation.inspect_tasks.registry.get_model", lambda: model)
    metadata = dict(made.dataset[0].metadata or {})
    state = TaskState(ModelName(model), f"{ALONE}/default", 1, "", [], metadata=metadata)
    playing = asyncio.ensure_future(made.solver(state, generate()))  # type: ignore[arg-type,operator]
    await silent.wait()
    playing.cancel()
    with pytest.raises(asyncio.CancelledError):
        await playing
    found = read_recording(Path(state.metadata["recording"]))
    assert found.verify().identical
    assert found.length == 3
    assert state.output.completion == state.messages[-1].text


def test_provider_errors_affect_one_sample(tmp_path: Path, evaluate: Evaluate) -> None:
    failing = iter([True])
    answer = of_plan()

    def answer_later(messages: list[ChatMessage]) -> str:
        if next(failing, False):
            raise OSError(f"the line to {KEY} broke")
        return answer(messages)

    log = evaluate(task(tmp_path), answer_later, epochs=2, max_samples=1)
    assert log.status == "success"
    assert log.samples is not None
    broken, played = sorted(log.samples, key=lambda sample: sample.error is None)
    assert broken.error is not None
    assert "the line to [key] broke" in broken.error.message
    assert KEY not in broken.error.traceback + broken.error.traceback_ansi
    assert value(played)["success"] == 1


def test_too_long_conversations_are_failures(tmp_path: Path, evaluate: Evaluate) -> None:
    from inspect_ai.model import ModelOutput, ModelUsage

    full = ModelOutput.from_content("mockllm", "too many tokens", stop_reason="model_length")
    full.usage = ModelUsage()
    sample = only(evaluate(task(tmp_path), lambda _: full))
    assert sample.error is None
    assert value(sample)["success"] == 0
    assert "too long for the model" in sample.scores["outcome"].explanation  # type: ignore[index,operator]
