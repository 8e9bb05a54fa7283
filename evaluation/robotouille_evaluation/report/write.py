"""A report on the disk: one page, every figure in two formats, every table as CSV."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from robotouille import World, load_task
from robotouille.certification.shipped_plan import plan_beside
from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille_client.console.pages.drawing import Picture
from robotouille_evaluation.metrics.rows import EpisodeRow
from robotouille_evaluation.report.dependency_graph import dependency_graph, draw_graph
from robotouille_evaluation.report.figures import all_figures
from robotouille_evaluation.report.grouping import datasets, tasks
from robotouille_evaluation.report.html import render_page
from robotouille_evaluation.report.tables import all_tables, csv_text

__all__ = ["task_graphs", "write_report"]

OURS = "ours"
"""The pack whose tasks are the shipped ones."""


def write_report(
    rows: Sequence[EpisodeRow],
    folder: Path,
    *,
    title: str = "Robotouille: results",
    graphs: Sequence[Picture] | None = None,
    folders: Mapping[str, Path] | None = None,
) -> Path:
    """Write `report.html`, `figures/NAME.svg` and `.png`, `tables/NAME.csv`, `rows.parquet`.

    Equal rows give equal bytes, in whatever order they come.

    Args:
        rows: Of one run, or of several that are compared.
        folder: Where to; it is made if there is none, and files of the same names are replaced.
        title: The page's.
        graphs: Pictures of the tasks; those of the shipped tasks that were played if None.
        folders: Where each run lies, by its name: the page names recordings so. If None, all are
            taken to be of the run in which the report's folder lies.

    Returns:
        The path of the page.

    Raises:
        MissingExtraError: Matplotlib, which draws figures, or PyArrow is not installed.
        OSError: The folder cannot be written.
    """
    if not all(map(find_spec, ("matplotlib", "numpy", "pyarrow"))):
        raise MissingExtraError("a report", "bench")
    from robotouille_evaluation.report.parquet import write_parquet

    rows = sorted(rows, key=_order)
    tables, figures = all_tables(rows), all_figures(rows)
    graphs = list(task_graphs(rows)) if graphs is None else graphs
    for name in ("figures", "tables"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for picture in (*figures, *graphs):
        (folder / "figures" / f"{picture.name}.svg").write_text(picture.svg, encoding="utf-8")
        (folder / "figures" / f"{picture.name}.png").write_bytes(picture.png)
    for table in tables:
        (folder / "tables" / f"{_file_name(table.name)}.csv").write_text(
            csv_text(table), encoding="utf-8"
        )
    write_parquet(rows, folder / "rows.parquet")
    page = folder / "report.html"
    if folders is None:
        folders = {row.run: folder.parent for row in rows}
    text = render_page(rows, tables, figures, graphs, title, folders)
    page.write_text(text, encoding="utf-8")
    return page


def _order(row: EpisodeRow) -> tuple[str, ...]:
    return (row.dataset, row.task, row.instance, row.player, row.model_dump_json())


def _file_name(name: str) -> str:
    """A table's name as that of a file: a data set may be called anything."""
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in name)[:80]


def task_graphs(rows: Sequence[EpisodeRow]) -> Iterator[Picture]:
    """The dependency graphs of the shipped tasks that were played, from their shipped plans."""
    own = [row for row in rows if row.pack.name == OURS]
    for dataset, group in datasets(own).items():
        for task in tasks(group):
            name = task if "/" in task else f"{dataset}/{task}"
            try:
                world = World(load_task(name, files=False))
            except RobotouilleError:
                continue  # another version's task
            plan = plan_beside(world)
            if plan is not None:
                yield draw_graph(f"graph_{name.replace('/', '_')}", dependency_graph(world, plan))
