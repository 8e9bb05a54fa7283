"""Conversations of the published evaluation are reproduced message for message.

The recorded answers are given to the strategy of the checkout's own configuration. Its requests,
the steps, the end and the logged values must equal the recorded ones.
"""

from __future__ import annotations

import json
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from robotouille import World
from robotouille.episode.record import RandomReversal, no_reversal
from robotouille_evaluation.agents.making import published_strategy
from robotouille_evaluation.agents.proposal import ContextOverflow
from robotouille_evaluation.models import Completion, ModelRequest
from robotouille_evaluation.packs.experiment import Experiment
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.packs.published_checkout import read_checkout
from robotouille_evaluation.packs.published_layouts import generate_layout
from robotouille_evaluation.runs.chance import PROBABILITIES, SingleReversal
from robotouille_evaluation.runs.episode_runner import PlainRunner
from robotouille_evaluation.runs.text_episode import TextEpisode, TextEpisodeResult
from tests.support.samples import quick_sample

PUBLISHED = Path(__file__).resolve().parents[4] / "shared/compat/published"
FILES = sorted(p.name for p in (PUBLISHED / "conversations").glob("*_*.json"))

pytestmark = pytest.mark.skipif(not FILES, reason="no published files beside the project")


@cache
def pack(seed: int | None) -> Pack:
    return read_checkout(PUBLISHED / "checkout", seeds=() if seed is None else (seed,)).pack


def world_of(recorded: dict[str, Any]) -> World:
    seed, kind = recorded["seed"], "noisy" if recorded["noisy"] else "free"
    kind = "default" if seed is None else kind
    found = [
        instance
        for instance in pack(seed).instances_of([recorded["problem"]], [kind])
        if instance.seed == seed
    ]
    return World(pack(seed).load(found[0], seats=1))


def undone_of(recorded: dict[str, Any]) -> RandomReversal:
    """Return reversals that continue the random numbers of the generator and the examples."""
    if not recorded["settings"]["game"]["stochastic"]:
        return no_reversal
    file = PUBLISHED / "checkout" / recorded["problem_file"]
    rng = generate_layout(json.loads(file.read_text()), recorded["seed"]).rng()
    rng.sample([0], 1)
    return SingleReversal("iscut", rng, PROBABILITIES["stochastic"])


def requests_of(recorded: dict[str, Any]) -> list[list[tuple[str, str]]]:
    table = [(message["role"], message["content"]) for message in recorded["messages"]]
    return [[table[i] for i in e["messages"]] for e in recorded["events"] if e["event"] == "llm"]


def experiment_of(recorded: dict[str, Any]) -> str:
    return str(recorded["experiment"]).removeprefix("conf/experiments/").removesuffix(".yaml")


def as_run(recorded: dict[str, Any]) -> Experiment:
    """Return the experiment with the overrides of the recorded run, and no others."""
    experiment = pack(None).experiment(experiment_of(recorded))
    settings = deepcopy(dict(experiment.settings))
    for override in recorded["overrides"]:
        name, _, value = override.partition("=")
        if name.startswith("llm."):
            settings["llm"][name.removeprefix("llm.")] = json.loads(value)
    handed_over = {k: v for k, v in recorded["settings"]["llm"].items() if k != "log_path"}
    assert {name: settings["llm"][name] for name in handed_over} == handed_over
    return replace(experiment, settings=settings)


class TooLongError(Exception):
    """Error that stops the published evaluation, which cannot shorten the request."""


def converse(recorded: dict[str, Any]) -> TextEpisodeResult:
    """Give the recorded answers and compare the requests."""
    strategy = published_strategy(pack(None), as_run(recorded))
    world, undone = world_of(recorded), undone_of(recorded)
    episode = TextEpisode(
        world,
        strategy,
        recorded["max_steps"],
        begin=lambda _: PlainRunner(world, undone),
        blind=True,
    )
    playing, request = episode.play(), ModelRequest(())
    asked = requests_of(recorded)
    answers = [e for e in recorded["events"] if e["event"] == "llm"]
    try:
        request = next(playing)
        for wanted, answer in zip(asked, answers, strict=True):
            assert [(m.role, m.content) for m in request.messages] == wanted
            assert request.purpose == answer["purpose"]
            if "error" in answer:
                request = playing.throw(ContextOverflow())
            else:
                request = playing.send(Completion(answer["answer"]))
    except StopIteration as stop:
        result: TextEpisodeResult = stop.value
        return result
    except ContextOverflow:
        raise TooLongError from None
    raise AssertionError(f"one more request than recorded: {request}")


@pytest.mark.parametrize("name", quick_sample(FILES))
def test_conversation_is_reproduced(name: str) -> None:
    recorded = json.loads((PUBLISHED / "conversations" / name).read_text())
    wanted = recorded["result"]
    if wanted["ended_by"] == "exception":
        with pytest.raises(TooLongError):
            converse(recorded)
        return
    result = converse(recorded)
    assert (result.ended, result.success) == (wanted["ended_by"], wanted["done"])
    assert result.logged_steps == wanted["steps"]
    assert len(result.exchanges) == wanted["llm_calls"]
    steps = [event["action"] for event in recorded["events"] if event["event"] == "step"]
    assert [taken.action for taken in result.taken] == steps
