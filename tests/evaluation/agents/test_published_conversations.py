"""Recorded conversations of the published evaluation come out message for message.

The scripted answers of each recording are given to the strategy that we make from the checkout's
own configuration; what it asks, the steps, the end and what is logged must be those recorded.
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
from robotouille.episode.episode_state import Undone, nothing_undone
from robotouille_evaluation.agents.making import published_strategy
from robotouille_evaluation.agents.proposal import ContextOverflow
from robotouille_evaluation.models import Completion, ModelRequest
from robotouille_evaluation.packs.pack import Experiment, Pack
from robotouille_evaluation.packs.published.checkout import read_checkout
from robotouille_evaluation.packs.published.layouts import generate_layout
from robotouille_evaluation.runs.stage import PlainStage
from robotouille_evaluation.runs.text_episode import TextEpisode, TextResult
from robotouille_evaluation.runs.variants import Reverting
from tests.support.samples import first_quickly

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


def undone_of(recorded: dict[str, Any]) -> Undone:
    """The stochastic environment goes on drawing where the generator and the examples stopped."""
    if not recorded["settings"]["game"]["stochastic"]:
        return nothing_undone
    file = PUBLISHED / "checkout" / recorded["problem_file"]
    rng = generate_layout(json.loads(file.read_text()), recorded["seed"]).rng()
    rng.sample([0], 1)
    return Reverting("iscut", rng)


def requests_of(recorded: dict[str, Any]) -> list[list[tuple[str, str]]]:
    table = [(message["role"], message["content"]) for message in recorded["messages"]]
    return [[table[i] for i in e["messages"]] for e in recorded["events"] if e["event"] == "llm"]


def experiment_of(recorded: dict[str, Any]) -> str:
    return str(recorded["experiment"]).removeprefix("conf/experiments/").removesuffix(".yaml")


def as_run(recorded: dict[str, Any]) -> Experiment:
    """The experiment with what the recorded run has set otherwise, and nothing else otherwise."""
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
    """What stops the published evaluation: it cannot shorten the request."""


def converse(recorded: dict[str, Any]) -> TextResult:
    """Give the recorded answers, and compare what is asked for them."""
    strategy = published_strategy(pack(None), as_run(recorded))
    world, undone = world_of(recorded), undone_of(recorded)
    episode = TextEpisode(
        world,
        strategy,
        recorded["max_steps"],
        begin=lambda _: PlainStage(world, undone),
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
        result: TextResult = stop.value
        return result
    except ContextOverflow:
        raise TooLongError from None
    raise AssertionError(f"one more request than recorded: {request}")


@pytest.mark.parametrize("name", first_quickly(FILES, 4))
def test_conversation(name: str) -> None:
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
