"""Published results from the notebook of a checkout, next to own results in a report."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robotouille.errors import FileError
from robotouille_evaluation.metrics import Result
from robotouille_evaluation.packs.pack import FigureData
from robotouille_evaluation.packs.published_checkout import read_checkout
from robotouille_evaluation.packs.published_figures import NOTEBOOK, read_figures
from robotouille_evaluation.packs.store import read_pack, write_pack
from robotouille_evaluation.report import published
from robotouille_evaluation.report.figures import all_figures
from robotouille_evaluation.report.reference import Reference, reference_of
from robotouille_evaluation.report.tables import all_tables
from tests.support.checkouts import write_checkout
from tests.support.episode_rows import made_up_rows, row
from tests.support.published import CHECKOUT, NEEDED

pytest.importorskip("yaml")

CELL = """\
%matplotlib inline
synchronous_step_to_go_ratios = [
    0.49, 0.5,  # a comment
    1.0, 1.5,
]
asynchronous_piechart_data = {
    'T': {'values': [3, 1], 'subcategories': ['[T] Violates "x" rule', '[T] Two'],
          'colors': ['#000000']},
    'G': {'values': [1], 'subcategories': ['[G] Bad Start']},
}
print(synchronous_step_to_go_ratios[0:2])
synchronous_success_repeated_actions = [0, 2]
"""


def notebook(*sources: str) -> str:
    cells = [
        {"cell_type": "code", "source": source.splitlines(keepends=True), "outputs": [{"x": 1}]}
        for source in sources
    ]
    return json.dumps({"cells": [{"cell_type": "markdown", "source": CELL}, *cells]})


def written(folder: Path, *sources: str) -> Path:
    return write_checkout(folder / "checkout", {NOTEBOOK: notebook(*sources)})


def test_literals_of_known_variables_are_read(tmp_path: Path) -> None:
    found = read_figures(written(tmp_path, "import numpy", CELL))
    player = "gpt-4o, ReAct"
    assert set(found) == {
        FigureData("steps_to_go", "synchronous", player, "failures", (0.49, 0.5, 1.0, 1.5)),
        FigureData("repeated_transitions", "synchronous", player, "successes", (0.0, 2.0)),
        FigureData("failures", "asynchronous", player, 'transition: Violates "x" rule', (3.0,)),
        FigureData("failures", "asynchronous", player, "transition: Two", (1.0,)),
        FigureData("failures", "asynchronous", player, "goal: Bad Start", (1.0,)),
    }


@pytest.mark.parametrize(
    "literal",
    [
        "[open('executed', 'w')]",
        "[1 + 1]",
        "[-1]",
        "[1e999]",
        f"[{'9' * 4000}]",
        f"[{'9' * 5000}]",
        f"[{'1, ' * 30_000}]",
        f"{'[' * 1000}1{']' * 1000}",
        "[1",
        "{[]: 1}",
        "['a']",
        "[1j]",
    ],
)
def test_other_values_are_refused_and_never_executed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, literal: str
) -> None:
    monkeypatch.chdir(tmp_path)
    root = written(tmp_path, f"synchronous_optimality = {literal}\n")
    with pytest.raises(FileError, match=r"figures\.ipynb: synchronous_optimality: expected"):
        read_figures(root)
    assert not (tmp_path / "executed").exists()
    imported = read_checkout(root, seeds=())
    assert not imported.pack.figures and "synchronous_optimality" in imported.faults[0]


@pytest.mark.parametrize("text", ["", "[]", "{", '{"cells": [null, {"cell_type": "code"}]}'])
def test_files_that_are_not_such_a_notebook(tmp_path: Path, text: str) -> None:
    root = write_checkout(tmp_path / "checkout", {NOTEBOOK: text})
    imported = read_checkout(root, seeds=())
    assert not imported.pack.figures
    assert NOTEBOOK in imported.missing or NOTEBOOK in imported.faults[0]


def test_notebook_of_millions_of_lists_is_not_parsed(tmp_path: Path) -> None:
    text = f'{{"cells": [{"[]," * 2_000_000}[]]}}'
    imported = read_checkout(write_checkout(tmp_path / "checkout", {NOTEBOOK: text}), seeds=())
    assert "values; at most 4,000,000 are read" in imported.faults[0]


def test_text_that_looks_like_assignments_is_read_once(tmp_path: Path) -> None:
    # Each of these lines begins inside a text, and a literal behind it would be read to the end.
    lines = 1000 * "'''\nsynchronous_optimality = [ #'''\n"
    cell = "synchronous_optimality = [\n" + lines + 15_000 * "'' " + "]"
    with pytest.raises(FileError, match="expected a list of numbers"):
        read_figures(written(tmp_path, cell))


@pytest.mark.parametrize("name", ["\\ud800", "\\x1b]0;a\\x07"])
def test_names_must_be_printable(tmp_path: Path, name: str) -> None:
    cell = f"synchronous_piechart_data = {{'S': {{'values': [1], 'subcategories': ['{name}']}}}}"
    with pytest.raises(FileError, match="not printable"):
        read_figures(written(tmp_path, cell))


def test_pack_keeps_published_results_and_its_digest(tmp_path: Path) -> None:
    without = read_checkout(write_checkout(tmp_path / "plain"), seeds=())
    assert NOTEBOOK in without.missing
    pack = read_checkout(written(tmp_path, CELL), seeds=()).pack
    assert pack.digest == without.pack.digest, "results do not depend on published ones"
    write_pack(pack, tmp_path / "pack")
    assert read_pack(tmp_path / "pack", digest=pack.digest).figures == pack.figures


@NEEDED
def test_published_numbers_give_the_printed_ones() -> None:
    reference = reference_of(read_figures(CHECKOUT))
    for mine, printed in (
        (reference.optimality, published.OPTIMALITY),
        (reference.steps_to_go, published.STEPS_TO_GO),
        # The text and the figure disagree about asynchronous failures.
        (reference.failures, {"synchronous": published.FAILURES["synchronous"]}),
    ):
        for dataset, shares in printed.items():
            rounded = {name: round(mine[dataset].get(name, 0), 1) for name in shares}
            assert rounded == pytest.approx(shares, abs=0.11), dataset


def test_tables_have_the_published_results(tmp_path: Path) -> None:
    reference = reference_of(read_figures(written(tmp_path, CELL)))
    rows = [row(), *made_up_rows(2)]
    tables = {table.name: table for table in all_tables(rows, reference)}
    theirs = [line.cells for line in tables["behaviour"].rows if line.reference]
    assert theirs[0][:4] == ("gpt-4o, ReAct", "synchronous", "1", "–")
    theirs = [line.cells for line in tables["failures"].rows if line.reference]
    assert ("gpt-4o, ReAct", "asynchronous", "goal", "Bad Start", "20 %", "–") in theirs
    assert ("gpt-4o, ReAct", "asynchronous", "transition", "all of them", "80 %", "–") in theirs
    (theirs_to_go,) = (line.cells for line in tables["steps_to_go"].rows if line.reference)
    assert theirs_to_go[2:8] == ("25 %", "25 %", "25 %", "25 %", "–", "50 %")


@pytest.mark.slow
def test_figures_have_the_published_results(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    rows = list(made_up_rows(2))
    reference = reference_of(read_figures(written(tmp_path, CELL)))
    plain, compared = ({f.name: f for f in all_figures(rows, *more)} for more in ((), (reference,)))
    changed = {name for name in plain if plain[name].svg != compared[name].svg}
    assert changed == {"optimality", "steps_to_go", "repeated_transitions", "failures"}
    assert "People decided about the published failures" in compared["failures"].caption
    won = [each["repeated_transitions"].svg.count(">won<") for each in (plain, compared)]
    assert won[0] < won[1], "published boxes name their result, too"


@pytest.mark.slow
def test_published_numbers_of_react_are_next_to_react_or_have_a_panel(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    reference = reference_of(read_figures(written(tmp_path, CELL)))
    failed = [each for each in made_up_rows(4) if each.agent == "random"]
    for name, beside in (("ReAct/synchronous/mine", True), ("IO/synchronous/io", False)):
        rows = [each.model_copy(update={"strategy": name}) for each in failed]
        plain, compared = ({f.name: f for f in all_figures(rows, r)}
                           for r in (Reference(steps_to_go={}), reference))  # fmt: skip
        for figure in ("steps_to_go", "repeated_transitions"):
            assert plain[figure].svg != compared[figure].svg
            assert "gpt-4o with ReAct" in compared[figure].caption
            assert ("gpt-4o, ReAct (published)" in compared[figure].svg) != beside, (figure, name)


@pytest.mark.slow
def test_figures_without_own_results_have_the_published_ones(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    reference = reference_of(read_figures(written(tmp_path, "synchronous_optimality = [1, 1.3]")))
    lost = Result(success=False, steps=12, ended_by="step-limit")
    rows = [row(agent="ReAct/x (m)", strategy="ReAct/x", outcome=lost)]
    drawn = {figure.name: figure for figure in all_figures(rows, reference)}
    assert "gpt-4o, ReAct (published)" in drawn["optimality"].svg
    changed = [each.model_copy(update={"variant": "stochastic"}) for each in rows]
    assert "optimality" not in {figure.name for figure in all_figures(changed, reference)}
    # The paper's text has some of the bins only.
    assert "optimality" not in {figure.name for figure in all_figures(rows, Reference())}
