"""Reports of made-up rows, and the page that describes them."""

from __future__ import annotations

import csv
import inspect
import random
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from robotouille import World, load_task
from robotouille.certification.step_limit import plan_beside
from robotouille.html_report.figures import inline_svg
from robotouille_evaluation.metrics import (
    PackId,
    Result,
    ResultRow,
    TotalUsage,
    asynchrony,
    measuring,
    outcomes,
    write_rows,
)
from robotouille_evaluation.metrics.failure_kinds import CATEGORIES
from robotouille_evaluation.report import write, write_report
from robotouille_evaluation.report.dependency_graph import dependency_graph
from robotouille_evaluation.report.figures import all_figures
from robotouille_evaluation.report.page import results_page
from robotouille_evaluation.report.tables import all_tables
from tests.support.episode_rows import made_up_rows, row, shift_row
from tests.support.games import recorded_game
from tests.support.page_tags import Tags, check_harmless
from tests.support.pages import blocks, read

HOSTILE = "<script>alert(1)</script>\"'&$x^2$ \x07 日本語 </style></svg>]]>-->{0}%s"


def page_of(rows: list[ResultRow]) -> str:
    return results_page(rows, all_tables(rows), all_figures(rows))


@pytest.fixture(scope="module")
def page() -> str:
    return page_of(list(made_up_rows(1)))


@pytest.mark.slow
def test_page_has_no_scripts_and_no_external_resources(page: str) -> None:
    check_harmless(page)
    links = [attributes.get("href") or "#" for _, attributes in Tags(page).found]
    assert all(link.startswith("#") for link in links)


@pytest.mark.slow
def test_ids_are_unique_and_links_have_targets(page: str) -> None:
    tags = Tags(page).found
    ids = [attributes["id"] for _, attributes in tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    links = {attributes.get("href") or attributes.get("xlink:href") for _, attributes in tags}
    assert {link[1:] for link in links if link} <= {*ids}
    clips = set(re.findall(r"url\(#([^)]+)\)", page))
    assert clips <= {*ids}


def test_tasks_that_are_not_shipped_are_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[str] = []

    def load(name: str, **options: Any) -> Any:
        loaded.append(name)
        return load_task(name, **options)

    monkeypatch.setattr(write, "load_task", load)
    shipped = "synchronous/01_cheese_sandwich"
    rows = [row(task=f"synchronous/unknown_{number}") for number in range(5)]
    (graph,) = write.task_graphs([*rows, row(task=shipped)])
    assert graph.name == "graph_synchronous_01_cheese_sandwich"
    assert loaded == [shipped]


def test_page_shows_scores_of_shifts() -> None:
    rows = [shift_row(87, task="01_x"), shift_row(50, task="02_x", agent="random")]
    text = page_of(rows)
    assert "87 points, 4 served, 1 expired" in text
    assert "best score / planner, shifts: planner" in text
    assert "1 episode, 50 % of the planner&#39;s score" in text
    assert "best success" not in text and "optimality" not in text


def test_page_names_instances_and_few_tokens() -> None:
    theirs = PackId(name="published", version="1", digest="0")
    usage = TotalUsage(prompt_tokens=38_000, completion_tokens=900)
    rows = [row(pack=theirs, kind="free", usage=usage)]
    text = results_page(rows, (), ())
    assert "100 instances of each data set. Instances of these in this report: 1 synch" in text
    assert "38,900" in text and "0.0389 M" not in text
    assert "measured on other instances" in results_page([row(kind="free")], (), ())


def test_page_names_the_best_agents_if_any_succeeded() -> None:
    lost = Result(success=False, steps=12, ended_by="step-limit")
    failed = [row(agent=name, outcome=lost) for name in "abc"]
    part = "best success, synchronous (1 of 10 tasks)"
    assert f"{part}<" in results_page(failed, (), ())
    assert f"{part}: d<" in results_page([*failed, row(agent="d")], (), ())
    both = [*failed, row(agent="d"), row(agent="e")]
    assert f"{part}: d and 1 more<" in results_page(both, (), ())


def test_page_shows_the_beginning_of_an_error() -> None:
    """The page contained all of each error, so that long ones took gigabytes."""
    page = results_page([row(error="no answer " * 10_000)], (), ())
    assert "no answer no answer" in page
    assert len(page) < len(results_page([row()], (), ())) + 1_000


@pytest.mark.slow
def test_text_of_rows_is_escaped() -> None:
    pack = PackId(name=HOSTILE, version=HOSTILE, digest=HOSTILE)
    fields = "run dataset task instance kind agent strategy model timing recording error"
    names = dict.fromkeys(fields.split(), HOSTILE)
    outcome = Result(success=False, steps=3, ended_by=HOSTILE)
    rows = [row(pack=pack, outcome=outcome, **names), *made_up_rows(1)]
    page = page_of(rows)
    assert "<script" not in page
    tags = Tags(page).found
    assert {tag for tag, _ in tags} <= {tag for tag, _ in Tags(page_of(rows[1:])).found} | {
        "ul",
        "li",
    }
    assert "alert(1)&lt;/script&gt;" in page


def test_recordings_have_paths_from_their_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(write, "all_figures", lambda *_: [])
    rows = [row(run=name, recording="recordings/a.rbt") for name in ("mine", "other")]
    folders = {"mine": Path("runs/my run"), "other": Path("/runs/other")}
    page = results_page(rows, (), (), folders=folders)
    assert "<code>&#39;runs/my run/recordings/a.rbt&#39;</code>" in page
    assert "<code>/runs/other/recordings/a.rbt</code>" in page
    inside = write_report(rows[:1], tmp_path / "x/report", graphs=()).read_text()
    assert f"<code>{tmp_path}/x/recordings/a.rbt</code>" in inside


@pytest.mark.slow
def test_hostile_names_stay_in_the_folder(tmp_path: Path) -> None:
    rows = [row(dataset="../../up", task="../x", run="/etc")]
    write_report(rows, tmp_path / "report", graphs=())
    assert {path.name for path in tmp_path.iterdir()} == {"report"}


def test_tables_of_similar_data_sets_have_files_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(write, "all_figures", lambda *_: [])
    rows = [row(dataset=name, task=f"task of {name}") for name in ("a b", "a-b", "A-B", "other")]
    write_report(rows, tmp_path, graphs=())
    files = sorted((tmp_path / "tables").glob("success_*.csv"))
    assert len({path.name.lower() for path in files}) == 4
    texts = "".join(path.read_text() for path in files)
    assert all(f"task of {name}" in texts for name in ("a b", "a-b", "A-B", "other"))
    assert (tmp_path / "tables/success_other.csv").is_file()


@pytest.mark.slow
def test_report_has_all_files_whatever_the_order_of_rows(tmp_path: Path) -> None:
    rows = list(made_up_rows(2))
    page = write_report(rows, tmp_path / "one")
    shuffled = rows.copy()
    random.Random(1).shuffle(shuffled)
    again = write_report(shuffled, tmp_path / "two")
    first = {p.relative_to(tmp_path / "one"): p.read_bytes() for p in files(tmp_path / "one")}
    second = {p.relative_to(tmp_path / "two"): p.read_bytes() for p in files(tmp_path / "two")}
    assert page.name == again.name == "report.html"
    assert first == second
    figures = {path.name for path in files(tmp_path / "one/figures")}
    for name in ("success", "optimality", "steps_to_go", "repeated_transitions", "failures",
                 "graph_asynchronous_06_potato_soup"):  # fmt: skip
        assert {f"{name}.svg", f"{name}.png"} <= figures
    with (tmp_path / "one/tables/success.csv").open(encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert [line["player"] for line in lines[:3]] == ["planner", "random", "react · small-model"]
    assert {line["source"] for line in lines[:3]} == {"own"}
    assert "ICLR" in lines[-1]["source"]


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


@pytest.mark.slow
def test_figures_are_embedded_in_the_page(page: str) -> None:
    for picture in all_figures(list(made_up_rows(2))):
        svg = inline_svg(picture)
        ElementTree.fromstring(svg)
        assert "style=" not in svg
        assert picture.png.startswith(b"\x89PNG")
    assert page.count("<svg") == page.count("<figure>") == 5


@pytest.mark.slow
def test_figures_without_data_are_left_out() -> None:
    rows = list(made_up_rows(2, {"planner": 1.0}))
    names = {picture.name for picture in all_figures(rows)}
    assert names == {"success", "optimality", "repeated_transitions"}


def test_dependency_graph_of_a_soup() -> None:
    """The potato goes into the filled pot, the water boils, and the soup goes into the bowl."""
    world = World(load_task("asynchronous/06"))
    plan = plan_beside(world)
    assert plan is not None
    graph = dependency_graph(world, plan)
    labels = [node.label for node in graph.nodes]
    assert sorted(labels) == sorted(
        ["pot", "fill-pot pot", "potato", "add-to potato", "boil-water water", "bowl",
         "fill-bowl water"]
    )  # fmt: skip
    assert [n.label for n in graph.nodes if n.asynchronous] == ["fill-pot pot", "boil-water water"]
    named = {(labels[a], labels[b]) for a, b in graph.edges}
    assert named == {
        ("pot", "fill-pot pot"),
        ("fill-pot pot", "add-to potato"),
        ("potato", "add-to potato"),
        ("add-to potato", "boil-water water"),
        ("boil-water water", "fill-bowl water"),
        ("bowl", "fill-bowl water"),
    }


PAGE = "metrics.md"
WITHOUT_NAME = {"cost", "is_optimal", "measure", "success_within", "tokens", "with_goal"}
"""Functions that the page describes without their names."""


@pytest.mark.slow
def test_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("episode.rbt").write_bytes(recorded_game("synchronous/01", steps=20))
    Path("rows.jsonl").write_text("".join(write_rows([row()])), encoding="utf-8")
    names: dict[str, Any] = {}
    for block in blocks(PAGE, "python"):
        exec(compile(block, PAGE, "exec"), names)
    assert Path("report/report.html").is_file()


def metrics(module: Any) -> set[str]:
    """Return the names of a module's public functions of a trajectory or of rows."""
    return {
        name
        for name, function in inspect.getmembers(module, inspect.isfunction)
        if function.__module__ == module.__name__
        and not name.startswith("_")
        and next(iter(inspect.signature(function).parameters)) in ("trajectory", "row", "rows")
    }


@pytest.mark.parametrize("module", [asynchrony, measuring, outcomes])
def test_the_page_defines_every_metric(module: Any) -> None:
    found = metrics(module)
    assert found
    page = read(PAGE)
    assert [name for name in found - WITHOUT_NAME if f"`{name}`" not in page] == []


def test_the_table_lists_every_subcategory() -> None:
    table = read(PAGE).partition("## Why episodes fail")[2]
    for subcategory, category in CATEGORIES.items():
        assert subcategory.value in table
        assert category.value in table
