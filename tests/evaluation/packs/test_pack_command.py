"""Command `robotouille pack`: output, files and errors."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from robotouille_client.cli.main import app
from robotouille_evaluation.packs.store import read_pack, write_pack
from tests.support.checkouts import EXPERIMENT, write_checkout
from tests.support.pages import read

pytest.importorskip("yaml")


def pack(*words: str | Path) -> Result:
    return CliRunner().invoke(app, ["pack", *map(str, words)])


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    return write_checkout(tmp_path / "checkout")


@pytest.fixture
def folder(tmp_path: Path, checkout: Path) -> Path:
    assert pack("import", checkout, "--out", tmp_path / "toast").exit_code == 0
    return tmp_path / "toast"


def test_import_lists_contents_and_missing_parts(tmp_path: Path, checkout: Path) -> None:
    result = pack("import", checkout, "--out", tmp_path / "toast")
    assert result.exit_code == 0
    assert "published 2.0, 1 tasks (1 default, 10 free, 10 noisy)" in result.stdout
    assert "missing: environments/env_generator/examples/multi_agent\n" in result.stderr
    assert "lacks 1 of the 2 tasks that its experiments name" in result.stderr
    assert '"Missing tasks" in docs/packs.md' in result.stderr
    assert "\n### Missing tasks\n" in read("packs.md")
    assert read_pack(tmp_path / "toast").digest in result.stdout


def test_import_of_all_tasks_counts_no_missing_ones(tmp_path: Path) -> None:
    both = '"synchronous/0_toast", "synchronous/1_absent"]'
    changed = EXPERIMENT.replace(both, '"synchronous/0_toast"]').replace("[5, 9]", "[5]")
    files = {"conf/experiments/ReAct/plain.yaml": changed}
    result = pack("import", write_checkout(tmp_path / "x", files), "--out", tmp_path / "toast")
    assert result.exit_code == 0
    assert "lacks" not in result.stderr


def test_default_folder_of_import(
    tmp_path: Path, checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert pack("import", checkout).exit_code == 0
    assert read_pack(tmp_path / "packs" / "published").name == "published"


def test_import_with_invalid_files(tmp_path: Path) -> None:
    bad = "environments/env_generator/examples/synchronous/1_bad.json"
    checkout = write_checkout(tmp_path / "checkout", {bad: "{"})
    result = pack("import", checkout, "--out", tmp_path / "toast", "--json")
    assert result.exit_code == 1
    row = json.loads(result.stdout)
    assert row["instances"] == {"default": 1, "free": 10, "noisy": 10}
    assert "1_bad.json: is not JSON" in row["faults"][0]


def test_import_without_checkout(tmp_path: Path) -> None:
    result = pack("import", tmp_path)
    assert result.exit_code == 1
    assert result.stdout == ""
    assert "not a checkout of the published repository" in result.stderr


def test_show(folder: Path) -> None:
    words = pack("show", folder).stdout
    assert "synchronous/0_toast: 21 instances, 5 steps (constant in ReAct/plain)" in words
    assert "prompts: ReAct/1.0.0-plain" in words
    row = json.loads(pack("show", folder, "--json").stdout)
    assert row["experiments"] == ["ReAct/plain"]
    assert row["tasks"] == [{"task": "synchronous/0_toast", "optimal": 5}]


def test_check_lists_faults(folder: Path) -> None:
    assert pack("check", folder).stdout == "no faults\n"
    found = read_pack(folder)
    broken = found.instances[0].problem.replace('"goal":[', '"goal":[{},')
    instances = [found.instances[0].__class__("x", "synchronous/0_toast", "free", 1, 1, broken)]
    write_pack(type(found)("toast", "1", found.domain, found.tasks, tuple(instances)), folder)
    result = pack("check", folder, "--json")
    assert result.exit_code == 1
    assert json.loads(result.stdout)["faults"]


def test_changed_pack_is_an_error(folder: Path) -> None:
    (folder / "tasks.json").write_text("[]")
    for command in ("show", "check"):
        result = pack(command, folder)
        assert result.exit_code == 1
        assert "tasks.json: was changed since the pack was made" in result.stderr


def test_diff(folder: Path, tmp_path: Path) -> None:
    other = write_checkout(tmp_path / "other", {"conf/experiments/ReAct/plain.yaml": None})
    assert pack("import", other, "--out", tmp_path / "other pack").exit_code == 0
    assert pack("diff", folder, folder).stdout == "no difference\n"
    text = pack("diff", folder, tmp_path / "other pack").stdout
    assert "By task" in text
    markdown = pack("diff", folder, tmp_path / "other pack", "--markdown").stdout
    assert "|  | budget | 8 | – |" in markdown
    row = json.loads(pack("diff", folder, tmp_path / "other pack", "--json").stdout)
    assert {"aspect": "optimum", "a": "5", "b": ""} in row["tasks"][0]["differences"]


def test_pack_names_cannot_control_the_terminal(folder: Path, tmp_path: Path) -> None:
    found = read_pack(folder)
    name = "[/red]\x1b[2J|x"
    other = replace(found, name=name, tasks=(replace(found.tasks[0], optimal=6),))
    write_pack(other, tmp_path / "other")
    for more in ([], ["--markdown"]):
        result = pack("diff", folder, tmp_path / "other", *more)
        assert result.exit_code == 0, result.output
        assert "\x1b" not in result.output and "/red" in result.output


def test_check_finds_missing_prompts_and_examples(folder: Path) -> None:
    write_pack(replace(read_pack(folder), prompts=(), examples=()), folder)
    result = pack("check", folder)
    assert result.exit_code == 1
    assert result.stdout.splitlines() == [
        "experiment ReAct/plain: the pack has no prompt 'ReAct/1.0.0-plain'",
        "experiment ReAct/plain: the pack has no examples 'synchronous/examples'",
    ]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"llm": []}, "llm: "),
        ({"game": []}, "game: "),
        ({"llm": {}}, "llm.prompts: Field required"),
        ({"llm": {"prompts": {"action_proposal_prompt": 3}}}, "llm.prompts.action_proposal_prompt"),
    ],
)
def test_invalid_experiments_are_errors(
    folder: Path, change: dict[str, object], words: str
) -> None:
    found = read_pack(folder)
    (experiment,) = found.experiments
    bad = replace(experiment, settings={**experiment.settings, **change})
    write_pack(replace(found, experiments=(bad,)), folder)
    result = pack("show", folder)
    assert result.exit_code == 1 and result.exception is not None
    assert isinstance(result.exception, SystemExit)
    assert f"experiment ReAct/plain: {words}" in " ".join(result.stderr.split())


@pytest.mark.slow
def test_build(tmp_path: Path) -> None:
    assert pack("build", "--out", tmp_path / "ours").exit_code == 0
    assert read_pack(tmp_path / "ours").name == "ours"
    assert pack("diff", "ours", tmp_path / "ours").stdout == "no difference\n"
