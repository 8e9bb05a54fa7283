"""`robotouille-verifiers` plays through the evaluation command of verifiers and as a library."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from robotouille import World
from robotouille_evaluation.text_games import Instances, load_instance
from tests.support.openai_server import Received, Reply, answer, answering, error
from tests.support.pages import blocks

pytestmark = [
    pytest.mark.slow,
    pytest.mark.process,
    pytest.mark.skipif(
        importlib.util.find_spec("robotouille_verifiers") is None,
        reason="robotouille-verifiers is not installed",
    ),
]

LIMIT = 240


def scripted(*texts: str | None) -> Callable[[Received], Reply]:
    """Return an endpoint's function that answers with the next text, or without text."""
    coming = iter(texts)
    return lambda _: answer(next(coming))


def plan_lines(name: str) -> list[str]:
    """Return the sentences of a certified plan."""
    instance = load_instance(name)
    return [action.sentence for step in instance.plan(World(instance.task)) for action in step]


async def evaluate(url: str, out: Path, *options: str) -> tuple[int, str, list[dict[str, Any]]]:
    """Run `vf-eval` for one game, and return exit code, output and traces."""
    program = [str(Path(sys.executable).with_name("vf-eval")), "robotouille-verifiers"]
    model = ["--model", "stub", "--client.base-url", url, "--client.api-key-var", "STUB_KEY"]
    where = ["--no-push", "--no-rich", "-n", "1", "-o", str(out), "--run.name", "run"]
    process = await asyncio.create_subprocess_exec(
        *program, *model, *where, *options,
        env={**os.environ, "STUB_KEY": "secret", "HOME": str(out)},
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )  # fmt: skip
    output, _ = await asyncio.wait_for(process.communicate(), LIMIT)
    found = list(out.rglob("traces.jsonl"))
    rows = [json.loads(line) for line in found[0].read_text().splitlines()] if found else []
    return process.returncode or 0, output.decode(), rows


def trace_of(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the only trace of the only episode."""
    ((trace,),) = [row["traces"] for row in rows]
    found: dict[str, Any] = trace
    return found


async def test_evaluation_command_rates_a_game_with_flawed_answers(tmp_path: Path) -> None:
    name = Instances("synchronous").name(0)
    flawed = ["I do not know.", "Action: Fly to the moon", "", None]
    said = [f"Reasoning: a plan\nAction: {line}" for line in plan_lines(name)]
    async with answering(scripted(*flawed, *said)) as server:
        code, output, rows = await evaluate(server.url, tmp_path)
    assert code == 0, output
    trace = trace_of(rows)
    scores = {name: reward["score"] for name, reward in trace["rewards"].items()}
    assert scores == {"success": 1, "optimality": 1, "progress": 1, "format": pytest.approx(8 / 12)}
    assert trace["metrics"]["malformed"] == 4
    # The requests of a game are one growing conversation, which is one sample for training.
    sizes = [len(each.body["messages"]) for each in server.received]
    assert sizes == list(range(sizes[0], sizes[0] + 24, 2))
    assert len(trace["nodes"]) == sizes[-1] + 1


async def test_a_game_that_is_cut_off_keeps_its_score(tmp_path: Path) -> None:
    seats = ["--env.taskset.dataset", "multi_agent", "--env.taskset.tasks", '["01"]']
    partner = ["--env.agent.harness.partner", "planner", "--env.agent.max-turns", "2"]
    async with answering(scripted("Action: Do nothing", "Action: " + "x" * 1_000_000)) as server:
        code, output, rows = await evaluate(server.url, tmp_path, *seats, *partner)
    assert code == 0, output
    trace = trace_of(rows)
    assert trace["stop_condition"] == "max_turns"
    assert trace["info"]["robotouille"]["ended"] is None
    assert trace["rewards"]["success"]["score"] == 0
    assert trace["metrics"]["steps"] == 1
    assert trace["metrics"]["answers"] == 2


async def test_an_endpoint_that_refuses_is_an_error_of_its_trace(tmp_path: Path) -> None:
    async with answering([error(401, "no such key")]) as server:
        _, output, rows = await evaluate(server.url, tmp_path)
    trace = trace_of(rows)
    assert not trace["ok"], output
    assert "no such key" in json.dumps(trace["errors"])


def test_environment_loads_every_data_set_and_split() -> None:
    from robotouille_verifiers import load_environment

    for dataset in ("synchronous", "asynchronous", "multi_agent", "shifts"):
        env = load_environment(dataset)
        assert env.taskset.bounded
        (first,) = env.taskset.take(1)
        assert first.data.prompt
    assert not load_environment("synchronous", "train").taskset.bounded


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"dataset": "soups"}, "synchronous"),
        ({"split": "valid"}, "train"),
        ({"agent": "reactfull"}, "did you mean 'react-full'"),
        ({"tasks": ["99"]}, "not one task of synchronous"),
        ({"partner": "friend"}, "unknown partner 'friend'"),
    ],
)
def test_wrong_option_says_what_is_possible(options: dict[str, Any], why: str) -> None:
    from robotouille_verifiers import load_environment

    with pytest.raises(ValueError, match=why):
        load_environment(**options)


def test_example_of_the_guide_runs() -> None:
    (example,) = blocks("training_hubs.md", "py")
    exec(example, {"print": lambda *_: None})
