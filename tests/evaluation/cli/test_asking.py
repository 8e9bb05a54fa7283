"""Model options from the command line to the endpoint, and where keys are sent."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import pytest
from typer.testing import CliRunner, Result

from robotouille.errors import RobotouilleError, WrongArgumentError
from robotouille_client.bots.llm_options import LlmBotOptions
from robotouille_evaluation.agents.making import PAPER_REACT
from robotouille_evaluation.agents.team import Control
from robotouille_evaluation.cli.benchmark import benchmark
from robotouille_evaluation.cli.bot import LanguageModelBot
from robotouille_evaluation.cli.models import ModelChoice
from robotouille_evaluation.cli.playing import MAX_FATAL
from robotouille_evaluation.models import (
    Completion,
    Endpoint,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    Prices,
    Usage,
)
from robotouille_evaluation.models.openai_compatible import KEY_VARIABLES
from robotouille_evaluation.packs import write_pack
from robotouille_evaluation.packs.experiment import Experiment
from robotouille_evaluation.runs import AgentSpec, EpisodeJob, RunFolder
from tests.support.runs import small_pack, started_run
from tests.support.samples import quick_sample

SANDWICH = "synchronous/01_cheese_sandwich"
RUN = [
    "--tasks", SANDWICH, "--kinds", "default", "--agents", "react-none",
    "--model", "m", "--base-url", "http://127.0.0.1:9/v1",
]  # fmt: skip


class FakeModel:
    """Model that records its endpoints, and fails while `failing` is set."""

    asked: list[Endpoint]
    failing: bool
    kind: ModelErrorKind

    def __init__(self, endpoint: Endpoint) -> None:
        self.name, self._endpoint = endpoint.model, endpoint
        FakeModel.asked.append(endpoint)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        pass

    async def complete(self, request: ModelRequest) -> Completion:
        await asyncio.sleep(0)  # Real answers are never immediate.
        if FakeModel.failing:
            raise ModelError(FakeModel.kind, "no whole answer in time", attempts=2)
        assert self._endpoint.prices is not None
        return Completion("Reasoning: .", Usage(1000, 10, self._endpoint.prices.cost(1000, 10)))


@pytest.fixture(autouse=True)
def fake(no_report: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    FakeModel.asked, FakeModel.failing, FakeModel.kind = [], False, ModelErrorKind.TIME_OUT
    for name in KEY_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("robotouille_evaluation.cli.models.OpenAICompatibleModel", FakeModel)
    yield


def called(*words: str | Path) -> Result:
    return CliRunner().invoke(benchmark, [str(word) for word in words])


@pytest.mark.slow
def test_costs_and_options_of_a_resumed_run(tmp_path: Path) -> None:
    FakeModel.failing = True
    how = ["--price", "2/8", "--timeout", "7.5", "--attempts", "2"]
    result = called("run", tmp_path / "r", *RUN, *how)
    assert result.exit_code == 1 and "1 episodes, 0 solved, 1 errors" in result.output
    assert "time-out: no whole answer in time" in result.output
    assert f"resume {tmp_path / 'r'}" in result.output
    (row,) = RunFolder(tmp_path / "r").rows()
    assert row.outcome.ended_by == "error" and "time-out" in str(row.error)
    FakeModel.failing = False
    assert called("resume", tmp_path / "r").exit_code == 0
    one, other = FakeModel.asked
    assert one == other
    assert (one.prices, one.timeout, one.attempts) == (Prices(2, 8), 7.5, 2)
    (row,) = RunFolder(tmp_path / "r").rows()
    assert row.error is None and row.counts.calls == row.counts.malformed > 0
    assert row.usage.cost == pytest.approx(row.counts.calls * 0.00208)


@pytest.mark.parametrize(
    ("kind", "played"),
    quick_sample([(ModelErrorKind.REFUSED, MAX_FATAL), (ModelErrorKind.TIME_OUT, 8)]),
)
def test_run_stops_after_fatal_errors(tmp_path: Path, kind: ModelErrorKind, played: int) -> None:
    FakeModel.failing, FakeModel.kind = True, kind
    result = called("run", tmp_path / "r", *RUN, "--seeds", "8", "--calls", "1", "--price", "1/1")
    assert result.exit_code == 1
    assert len(RunFolder(tmp_path / "r").rows()) == played
    assert ("stopped: the first 5" in result.output) == (played < 8)
    FakeModel.failing = False
    assert called("resume", tmp_path / "r", "--calls", "8").exit_code == 0


def test_run_without_key_does_not_begin(tmp_path: Path) -> None:
    result = called("run", tmp_path / "r", *RUN[:-2])
    assert result.exit_code == 1
    assert "https://api.openai.com/v1 requires a key" in result.output
    assert "--base-url" in result.output
    assert not (tmp_path / "r").exists()


@pytest.mark.slow
def test_resume_requires_the_base_url_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    FakeModel.failing = True
    assert called("run", tmp_path / "r", *RUN, "--price", "1/1").exit_code == 1
    monkeypatch.setenv(KEY_VARIABLES[0], "sk-0123456789")
    FakeModel.asked, FakeModel.failing = [], False
    for given in ([], ["--base-url", "http://127.0.0.1:8/v1"]):
        result = called("resume", tmp_path / "r", *given)
        assert result.exit_code == 1
        assert "--base-url http://127.0.0.1:9/v1" in result.output
    assert not FakeModel.asked
    assert called("resume", tmp_path / "r", "--base-url", "http://127.0.0.1:9/v1").exit_code == 0
    assert FakeModel.asked


@pytest.mark.parametrize("harmless", [{"model": "mock"}, {"base_url": ""}])
def test_agents_with_equal_names_get_no_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, harmless: dict[str, str]
) -> None:
    """Only the last agent of a name was checked, and all of them were played."""
    monkeypatch.setenv(KEY_VARIABLES[0], "sk-0123456789")
    spec = AgentSpec(name="a", kind="model", strategy="react-none", model="m",
                     base_url="http://127.0.0.1:9/v1")  # fmt: skip
    pack = small_pack(SANDWICH)
    job = EpisodeJob(agent=spec, instance=pack.instances[0].id, seats=1, seed=0, budget="own")
    alike = job.model_copy(update={"seed": 1, "agent": spec.model_copy(update=harmless)})
    plan = started_run(tmp_path, pack, job).path / "run.json"
    write_pack(pack, tmp_path / "pack")
    content = json.loads(plan.read_text())
    content["jobs"].append(alike.model_dump(mode="json"))
    content["pack_folder"] = "pack"
    plan.write_text(json.dumps(content))
    result = called("resume", tmp_path)
    assert result.exit_code == 1
    assert "two different agents are named 'a'" in result.output
    assert not FakeModel.asked


@pytest.mark.parametrize(
    ("choice", "is_sent_none"),
    [
        (ModelChoice("mock"), True),
        (ModelChoice("m"), True),
        (ModelChoice("m", "http://localhost:8000/v1"), True),
        (ModelChoice("m", "http://[::1]:8000/v1"), True),
        (ModelChoice("m", "https://127.0.0.1/v1"), False),  # is sent OPENAI_API_KEY
        (ModelChoice("m", "http://127.0.0.1.example.org/v1"), False),
        (ModelChoice("m", "https://api.openai.com.example.org/v1"), False),
        (ModelChoice("inspect:openai/m"), True),
        (ModelChoice("inspect:openai/m", "http://127.0.0.1/v1"), False),
    ],
)
def test_addresses_that_may_receive_keys(
    monkeypatch: pytest.MonkeyPatch, choice: ModelChoice, is_sent_none: bool
) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "sk-0123456789")
    assert choice.is_sent_no_secret == is_sent_none


@pytest.mark.parametrize(
    ("model", "options", "expected"),
    [
        ("m", {"base_url": ""}, "requires a key"),
        ("m", {"strategy": "oi"}, "no strategy 'oi'"),
        ("m", {"transcript": Path("/nowhere/said.jsonl")}, "cannot be written"),
    ],
)
async def test_bot_without_key_takes_no_seat(
    monkeypatch: pytest.MonkeyPatch, model: str, options: dict[str, Any], expected: str
) -> None:
    monkeypatch.undo()
    for name in KEY_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    usual = {"model": model, "base_url": "http://127.0.0.1:9/v1", "strategy": "io"}
    bot = LanguageModelBot.of(LlmBotOptions(**{**usual, **options}), seed=1)
    with pytest.raises(RobotouilleError, match=expected):
        async with bot.opened():
            pass


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("--price", "cheap", "2.50/10"),
        ("--timeout", "0", "--timeout"),
        ("--attempts", "0", "--attempts"),
    ],
)
def test_invalid_options_are_refused_early(
    tmp_path: Path, option: str, value: str, expected: str
) -> None:
    result = called("run", tmp_path / "r", *RUN, option, value)
    assert result.exit_code != 0
    assert expected in result.output
    assert not (tmp_path / "r").exists()


def test_bot_options_reach_the_endpoint() -> None:
    options: dict[str, Any] = {
        "model": "m", "base_url": "http://127.0.0.1:9/v1", "strategy": "io", "temperature": 0.5,
        "timeout": 3.0, "attempts": 1,
    }  # fmt: skip
    bot = LanguageModelBot.of(LlmBotOptions(**options, price="1/2"), seed=1)
    endpoint = bot.model.endpoint()
    assert endpoint.parameters == {"temperature": 0.5}
    assert (endpoint.prices, endpoint.timeout, endpoint.attempts) == (Prices(1, 2), 3.0, 1)
    with pytest.raises(WrongArgumentError, match="prices"):
        LanguageModelBot.of(LlmBotOptions(**options, price="1"))
    assert ModelChoice("m").endpoint() == Endpoint("m")


@pytest.mark.parametrize("control", ["each", "turns", "joint"])
async def test_bot_plays_the_papers_react_by_default(control: Control) -> None:
    bot = LanguageModelBot.of(LlmBotOptions(), control=control)
    assert bot.strategy == ("react-last-reasoning-action" if control == "joint" else PAPER_REACT)
    assert LanguageModelBot(ModelChoice("m")).strategy == PAPER_REACT
    async with bot.opened():  # raises an error if the strategy does not support the control
        pass


async def test_bot_plays_the_experiments_of_a_pack(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    prompt = {"experiment_name": "IO", "prompt_version": "1", "prompt_description": "x"}
    settings = {"llm": {"prompts": {"action_proposal_prompt": prompt}}}
    experiment = Experiment("IO/mine", "io", (), (), (), settings)
    pack = small_pack()
    prompts = (*pack.prompts, replace(pack.prompts[0], id="IO/1-x"))
    write_pack(replace(pack, prompts=prompts, experiments=(experiment,)), folder)
    options = LlmBotOptions(strategy="IO/mine", pack=str(folder))
    async with LanguageModelBot.of(options).opened():
        pass
    assert LanguageModelBot.of(options).agent == "mock strategy=IO/mine seed=0 pack=mine"
    for wrong, expected in ("our", "did you mean 'ours'"), (str(tmp_path), "manifest.json"):
        with pytest.raises(RobotouilleError, match=expected):
            async with LanguageModelBot.of(LlmBotOptions(pack=wrong)).opened():
                pass
