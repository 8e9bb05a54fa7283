"""How models are asked: prices, time-outs and attempts from the command line to the endpoint."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import pytest
from typer.testing import CliRunner, Result

from robotouille.errors import WrongArgumentError
from robotouille_evaluation.cli.benchmark import benchmark
from robotouille_evaluation.cli.bot import LanguageModelBot
from robotouille_evaluation.cli.models import ModelChoice
from robotouille_evaluation.models import (
    Completion,
    Endpoint,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    Prices,
    Usage,
)
from robotouille_evaluation.runs import RunFolder

RUN = [
    "--tasks", "synchronous/01_cheese_sandwich", "--kinds", "default", "--agents", "react-none",
    "--model", "m", "--base-url", "http://127.0.0.1:9/v1",
]  # fmt: skip


class FakeModel:
    """Notes how it is asked; fails while it is told to."""

    asked: list[Endpoint]
    failing: bool

    def __init__(self, endpoint: Endpoint) -> None:
        self.name, self._endpoint = endpoint.model, endpoint
        FakeModel.asked.append(endpoint)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        pass

    async def complete(self, request: ModelRequest) -> Completion:
        if FakeModel.failing:
            raise ModelError(ModelErrorKind.TIME_OUT, "no whole answer in time", attempts=2)
        assert self._endpoint.prices is not None
        return Completion("Reasoning: .", Usage(1000, 10, self._endpoint.prices.cost(1000, 10)))


@pytest.fixture(autouse=True)
def fake(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    FakeModel.asked, FakeModel.failing = [], False
    monkeypatch.setattr("robotouille_evaluation.cli.models.OpenAICompatibleModel", FakeModel)
    monkeypatch.setattr(
        "robotouille_evaluation.report.write_report",
        lambda rows, folder, **_: folder / "report.html",
    )
    yield


def called(*words: str | Path) -> Result:
    return CliRunner().invoke(benchmark, [str(word) for word in words])


def test_prices_make_costs_and_a_resumed_run_asks_alike(tmp_path: Path) -> None:
    FakeModel.failing = True
    how = ["--price", "2/8", "--timeout", "7.5", "--attempts", "2"]
    assert called("run", tmp_path / "r", *RUN, *how).exit_code == 0
    (row,) = RunFolder(tmp_path / "r").rows()
    assert row.outcome.ended_by == "error" and "time-out" in str(row.error)
    FakeModel.failing = False
    assert called("resume", tmp_path / "r").exit_code == 0
    one, other = FakeModel.asked
    assert one == other
    assert (one.prices, one.timeout, one.retries.attempts) == (Prices(2, 8), 7.5, 2)
    (row,) = RunFolder(tmp_path / "r").rows()
    assert row.error is None and row.counts.calls == row.counts.malformed > 0
    assert row.usage.cost == pytest.approx(row.counts.calls * 0.00208)


def test_a_resumed_run_can_be_more_patient(tmp_path: Path) -> None:
    FakeModel.failing = True
    assert called("run", tmp_path / "r", *RUN, "--price", "1/1").exit_code == 0
    FakeModel.failing = False
    result = called("resume", tmp_path / "r", "--timeout", "900", "--attempts", "9")
    assert result.exit_code == 0
    usual, patient = FakeModel.asked
    assert (usual.timeout, usual.retries.attempts) == (120, 6)
    assert (patient.timeout, patient.retries.attempts) == (900, 9)
    assert len((tmp_path / "r/rows.jsonl").read_text().splitlines()) == 2
    assert len(RunFolder(tmp_path / "r").rows()) == 1, "the same job"


@pytest.mark.parametrize(
    ("option", "value", "told"),
    [
        ("--price", "cheap", "2.50/10"),
        ("--timeout", "0", "--timeout"),
        ("--attempts", "0", "--attempts"),
    ],
)
def test_mistakes_are_told_before_anything_is_begun(
    tmp_path: Path, option: str, value: str, told: str
) -> None:
    result = called("run", tmp_path / "r", *RUN, option, value)
    assert result.exit_code != 0
    assert told in result.output
    assert not (tmp_path / "r").exists()


def test_a_bot_is_asked_alike() -> None:
    options: dict[str, Any] = {
        "base_url": "http://127.0.0.1:9/v1", "strategy": "io", "transcript": None, "seed": 1,
        "temperature": 0.5,
    }  # fmt: skip
    how = {"prices": "1/2", "timeout": 3.0, "attempts": 1}
    bot = LanguageModelBot.of("m", **options, **how)
    endpoint = bot.model.endpoint()
    assert endpoint.parameters == {"temperature": 0.5}
    assert (endpoint.prices, endpoint.timeout, endpoint.retries.attempts) == (Prices(1, 2), 3.0, 1)
    with pytest.raises(WrongArgumentError, match="prices"):
        LanguageModelBot.of("m", **options, **{**how, "prices": "1"})
    assert ModelChoice("m").endpoint() == Endpoint("m")
