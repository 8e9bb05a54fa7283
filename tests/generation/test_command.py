"""The command `robotouille generate`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from robotouille import load_task
from robotouille.domain.schema import Provenance
from robotouille_client.cli.main import app
from tests.support.pages import blocks

SANDWICH = "synchronous/01"


def generate(*words: str) -> Result:
    return CliRunner().invoke(app, ["generate", *words])


@pytest.mark.slow
def test_files_pass_the_linter(tmp_path: Path) -> None:
    out = tmp_path / "new"
    result = generate(SANDWICH, "--kind", "noisy", "--count", "3", "--out", str(out))
    assert result.exit_code == 0, result.output
    files = sorted(out.iterdir())
    assert [f.name for f in files] == [f"01_cheese_sandwich_s{s}.json" for s in (126, 42, 84)]
    assert "noisy, attempt 1; solved in 8 steps" in result.stdout
    linted = CliRunner().invoke(app, ["lint", *map(str, files)])
    assert linted.exit_code == 0
    assert linted.stdout.count("no faults") == 3
    text = files[0].read_text()
    assert generate(SANDWICH, "--kind", "noisy", "--seed", "126", "--out", "-").stdout == text


def test_json_has_one_line_per_file(tmp_path: Path) -> None:
    words = ["multi_agent/01", "--kind", "noisy", "--seed", "7", "--size", "9x8", "--stations", "3"]
    result = generate(*words, "--items", "1", "--out", str(tmp_path), "--json")
    row = json.loads(result.stdout)
    assert row["steps"].keys() == {"2", "3", "4"}
    assert (row["seed"], row["kind"], row["attempt"]) == (7, "noisy", 1)
    task = load_task(row["file"])
    assert (task.problem.width, task.problem.height) == (9, 8)
    assert len(task.problem.objects["station"]) == 12


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["synchronous/99"], "no task or file 'synchronous/99'; did you mean"),
        ([SANDWICH, "--size", "3"], "size: expected WIDTHxHEIGHT like 6x5, found '3'"),
        ([SANDWICH, "--size", "3x0"], "size: expected 1 to 100, found 0"),
        ([SANDWICH, "--kind", "noisy", "--held"], "held: players of a noisy instance"),
        ([SANDWICH, "--min-steps", "9", "--max-steps", "3"], "min-steps: 9 is more than"),
        ([SANDWICH, "--size", "3x3"], "of 7 stations fit on a grid of 3 by 3"),
        ([SANDWICH, "--count", "2", "--out", "-"], "--out - is for one instance"),
        ([SANDWICH, "--kind", "noisy", "--out", "/dev/null/x"], "/dev/null is a file"),
    ],
)
def test_errors_have_one_line(words: list[str], said: str) -> None:
    result = generate(*words)
    assert result.exit_code == 1
    assert said in result.output
    assert len(result.output.strip().splitlines()) == 1


@pytest.mark.parametrize("content", [b"{}", b"\xff", b"\0" * 5_000_000])
def test_other_files_are_not_replaced(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "01_cheese_sandwich_s42.json"
    file.write_bytes(content)
    result = generate(SANDWICH, "--kind", "noisy", "--out", str(tmp_path))
    assert (result.exit_code, file.read_bytes()) == (1, content)
    assert "contains another instance" in result.output


def test_page_examples_are_right(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = [b for b in blocks("planners.md", "python") if "Generator(" in b]
    exec(compile(block, "planners.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "01_lettuce_burger_s42"
    assert "# task: 01_lettuce_burger_s42@3" in lines
    assert lines[-1] == "lettuce1"
    received = json.loads("{" + blocks("planners.md", "json")[0] + "}")
    Provenance.model_validate(received["provenance"])
