"""Import of checkouts: contents, missing parts and faults."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest

from robotouille import World
from robotouille.errors import FileError
from robotouille_evaluation.packs.checking import check_pack
from robotouille_evaluation.packs.pack import ExampleStep, Pack
from robotouille_evaluation.packs.published_checkout import SEEDS, read_checkout
from tests.support.checkouts import EXPERIMENT, PROBLEM, write_checkout
from tests.support.published import CHECKOUT, NEEDED, conversations, read
from tests.support.samples import quick_sample

pytest.importorskip("yaml")

TOAST = "environments/env_generator/examples/synchronous/0_toast.json"
BAD = "environments/env_generator/examples/synchronous/1_bad.json"
PLAIN = "conf/experiments/ReAct/plain.yaml"
PROMPT = "agents/prompt_builder/prompts/ReAct/1.0.0-plain.yml"
EXAMPLES = "agents/in_context_examples/data/synchronous/examples"
ID_WITH_COLON = "conf/experiments/kitchen:react.yaml"
EXAMPLE = f"{EXAMPLES}/0_toast_26.txt"
SETTINGS_OF_A_RUN = {"log_path", "retries"}
"""Settings that the command lines of the recorded runs changed."""


@cache
def published() -> Pack:
    return read_checkout(CHECKOUT, seeds=SEEDS[:1]).pack


@NEEDED
def test_published_checkout() -> None:
    found = read_checkout(CHECKOUT)
    assert not found.faults
    assert all("/env_generator/" in name for name in found.missing)
    kinds = [instance.kind for instance in found.pack.instances]
    assert kinds.count("free") == kinds.count("noisy") == 160
    assert found.pack.task("synchronous/2_lettuce_tomato_sandwich").optimal == 24


@pytest.mark.slow
@NEEDED
def test_every_published_instance_loads() -> None:
    assert check_pack(published()) == []
    task = published().load("synchronous/0_cheese_sandwich_42")
    assert World(task).initial.text().endswith("Goal: Prepare a cheese sandwich on a table")


@NEEDED
@pytest.mark.parametrize("path", quick_sample(conversations(), quick=2), ids=lambda p: p.stem)
def test_recorded_conversations_begin_with_the_pack_prompts(path: Path) -> None:
    recorded = read(path)
    name = recorded["experiment"].removeprefix("conf/experiments/").removesuffix(".yaml")
    llm = published().experiment(name).settings["llm"]
    for setting, value in recorded["settings"]["llm"].items():
        assert llm[setting] == value or setting in SETTINGS_OF_A_RUN, setting
    messages = recorded["messages"]
    for event in recorded["events"]:
        if event["event"] == "llm":
            sent = [messages[i]["content"] for i in event["messages"]]
            check_beginning(sent, event["purpose"], llm)


def check_beginning(sent: list[str], purpose: str, llm: dict[str, object]) -> None:
    which = {"propose": "action_proposal_prompt", "reflect": "reflection_prompt"}[purpose]
    ids = llm["prompts"][which]  # type: ignore[index]
    group, version = ids["experiment_name"], ids["prompt_version"]
    prompt = published().prompt(f"{group}/{version}-{ids['prompt_description']}")
    assert sent[:2] == [prompt.system, prompt.instructions]
    if purpose == "propose" and llm["num_examples"]:
        (episode,) = published().example_set(str(llm["example_dir_path"])).episodes
        shown = [text for step in episode.steps for text in (step.user, step.assistant)]
        assert sent[2 : 2 + len(shown)] == shown


def test_import_of_a_small_checkout(tmp_path: Path) -> None:
    found = read_checkout(write_checkout(tmp_path), seeds=[42, 84])
    pack = found.pack
    assert not found.faults
    assert [instance.id for instance in pack.instances] == [
        "synchronous/0_toast",
        "synchronous/0_toast_42",
        "synchronous/0_toast_84",
        "synchronous/0_toast_42_noisy",
        "synchronous/0_toast_84_noisy",
    ]
    task = pack.task("synchronous/0_toast")
    assert (task.optimal, task.optimal_from) == (5, "constant in ReAct/plain")
    prompt = pack.prompt("ReAct/1.0.0-plain")
    assert prompt.system == "Be a cook."
    assert prompt.instructions == "Answer so:\nReasoning: ...\nAction: ..."
    (episode,) = pack.example_set("synchronous/examples").episodes
    assert episode.steps == (
        ExampleStep(
            "...\n\nGoal: Put cheese on bread\n\n", "Reasoning: It is there.\n\nAction: Do nothing"
        ),
    )
    assert check_pack(pack) == []


def test_settings_are_merged(tmp_path: Path) -> None:
    experiment = read_checkout(write_checkout(tmp_path), seeds=[]).pack.experiment("ReAct/plain")
    assert experiment.agent == "ReAct"
    assert experiment.seeds == (42,)
    assert experiment.settings["game"]["stochastic"] is False
    assert experiment.settings["game"]["max_steps"] is None
    llm = experiment.settings["llm"]
    assert llm["log_path"] == "${hydra:runtime.output_dir}/log"
    assert llm["prompts"]["action_proposal_prompt"] == {
        "experiment_name": "ReAct",
        "prompt_description": "plain",
        "prompt_version": "1.0.0",
        "temperature": 0.7,
    }
    assert experiment.settings["game"]["max_step_multiplier"] == 1.5


def test_values_without_json_become_text(tmp_path: Path) -> None:
    base = "agent_name: human\nsince: 2024-05-01\n1: .nan\n"
    found = read_checkout(write_checkout(tmp_path, {"conf/game/base_game.yaml": base}), seeds=[])
    game = found.pack.experiment("ReAct/plain").settings["game"]
    assert (game["since"], game["1"]) == ("2024-05-01", "nan")


@pytest.mark.parametrize(
    ("absent", "missing"), [(PROMPT, PROMPT), (EXAMPLE, EXAMPLES), (PLAIN, "conf/experiments")]
)
def test_missing_parts_are_listed(tmp_path: Path, absent: str, missing: str) -> None:
    found = read_checkout(write_checkout(tmp_path, {absent: None}), seeds=[42])
    assert missing in found.missing
    assert not found.faults
    assert len(found.pack.instances) == 3


def test_missing_tasks_of_experiments(tmp_path: Path) -> None:
    found = read_checkout(write_checkout(tmp_path), seeds=[])
    assert "environments/env_generator/examples/synchronous/1_absent.json" in found.missing


@pytest.mark.parametrize(
    ("path", "text", "fault"),
    [
        (PLAIN, "a: [", "is not YAML"),
        (PLAIN, "- a", "expected settings by name"),
        (PLAIN, EXPERIMENT.replace("[5, 9]", "[5]"), "2 tasks, but 1 optimal_steps"),
        (PLAIN, EXPERIMENT.replace("[5, 9]", "[five, 9]"), "optimal_steps: expected a list of int"),
        (
            PLAIN,
            EXPERIMENT.replace("agent_name: ReAct", "agent_name: ${llm.nobody}"),
            "unknown setting ${llm.nobody}",
        ),
        (
            PLAIN,
            EXPERIMENT.replace("agent_name: ReAct", "agent_name: ${game.agent_name}"),
            "${game.agent_name} refers to itself",
        ),
        ("conf/llm/base_llm.yaml", "!!python/object:os.system {}", "is not YAML"),
        (ID_WITH_COLON, EXPERIMENT, "the id of an experiment has no colon"),
        (PROMPT, "system: 1", "expected a text"),
        (EXAMPLE, "Cheese!", "has no interaction"),
        (EXAMPLE, "Interaction 1\n---\nNothing\n", "interaction 1: no observation with an answer"),
        (BAD, "{", "is not JSON"),
        (BAD, "[]", "found []"),
        (BAD, json.dumps({**PROBLEM, "recipes": 3}), "unknown field 'recipes'"),
        (BAD, json.dumps({**PROBLEM, "players": []}), "has no player"),
    ],
)
def test_invalid_files_are_listed_and_the_rest_is_read(
    tmp_path: Path, path: str, text: str, fault: str
) -> None:
    found = read_checkout(write_checkout(tmp_path, {path: text}), seeds=[42])
    assert any(fault in line for line in found.faults), found.faults
    assert len(found.pack.instances) == 3


def test_folder_without_checkout(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"has no domain/robotouille\.json and no environments/"):
        read_checkout(tmp_path)
    with pytest.raises(FileError, match="is not a folder"):
        read_checkout(tmp_path / "absent")


@pytest.mark.parametrize(
    ("path", "text", "words"),
    [
        ("domain/robotouille.json", None, r"it has no domain/robotouille\.json"),
        ("domain/robotouille.json", '{"name": "x"}', "is it another version"),
        ("domain/robotouille.json", "#", "is not JSON"),
        (TOAST, None, "has no environments"),
        (TOAST, "{", "no problem of the benchmark"),
    ],
)
def test_checkout_of_another_version(
    tmp_path: Path, path: str, text: str | None, words: str
) -> None:
    with pytest.raises(FileError, match=words):
        read_checkout(write_checkout(tmp_path, {path: text}))
