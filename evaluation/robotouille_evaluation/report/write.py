"""Files of a report: the page, figures in two formats, tables as CSV and rows as Parquet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel

from robotouille import World, load_task, task_names
from robotouille.certification.step_limit import plan_beside
from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille.files.writing import replace_file, whole_file
from robotouille.html_report import require_libraries
from robotouille.html_report.figures import ReportFigure
from robotouille_evaluation.metrics.rows import Category, Measure, Name, Number, ResultRow
from robotouille_evaluation.packs.pack import FigureData
from robotouille_evaluation.report.dependency_graph import dependency_graph, draw_graph
from robotouille_evaluation.report.figures import all_figures
from robotouille_evaluation.report.grouping import datasets, tasks
from robotouille_evaluation.report.reference import reference_of
from robotouille_evaluation.report.tables import all_tables, csv_text

ROW_GROUP = 250
"""Rows that are converted at once, because that takes several times their memory."""
OURS = "ours"
"""Name of the pack with the shipped tasks."""


def write_report(
    rows: Sequence[ResultRow],
    folder: Path,
    *,
    title: str = "Robotouille: results",
    graphs: Sequence[ReportFigure] | None = None,
    folders: Mapping[str, Path] | None = None,
    figures: Iterable[FigureData] = (),
) -> Path:
    """Write `report.html`, `figures/NAME.svg` and `.png`, `tables/NAME.csv` and `rows.parquet`.

    Equal rows give equal bytes, whatever their order.

    Args:
        rows: Results of one run, or of several runs to compare.
        folder: Folder of the report, created if missing. Existing files are replaced.
        title: Title of the page.
        graphs: Figures of the tasks. By default, the dependency graphs of the shipped tasks that
            were played.
        folders: The folder of each run by its name, for the paths of recordings. By default, the
            parent of the report's folder.
        figures: Published results of an imported pack. By default, the numbers that the paper
            prints.

    Returns:
        The path of the page.

    Raises:
        MissingExtraError: A library for pages, figures or Parquet is not installed.
        OSError: The folder cannot be written.
    """
    require_libraries("a report", "bench")
    if find_spec("pyarrow") is None:
        raise MissingExtraError("a report", "bench")
    from robotouille_evaluation.report.page import results_page

    rows = sorted(rows, key=_order)
    reference = reference_of(figures)
    tables, drawn = all_tables(rows, reference), all_figures(rows, reference)
    graphs = list(task_graphs(rows)) if graphs is None else graphs
    for name in ("figures", "tables"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for figure in (*drawn, *graphs):
        replace_file(folder / "figures" / f"{figure.name}.svg", figure.svg)
        replace_file(folder / "figures" / f"{figure.name}.png", figure.png)
    names = _file_names([table.name for table in tables])
    for table, name in zip(tables, names, strict=True):
        replace_file(folder / "tables" / f"{name}.csv", csv_text(table))
    write_parquet(rows, folder / "rows.parquet")
    page = folder / "report.html"
    if folders is None:
        folders = {row.run: folder.parent for row in rows}
    replace_file(page, results_page(rows, tables, drawn, graphs, title, folders))
    return page


def _order(row: ResultRow) -> tuple[object, ...]:
    # The digest distinguishes other rows without a copy of their texts.
    digest = sha256(row.model_dump_json().encode()).digest()
    return (row.dataset, row.task, row.instance, row.player, row.seed, row.run, row.job, digest)


def _file_names(names: Sequence[str]) -> list[str]:
    """Return file names for tables. Equal ones are followed by a part of the name's digest."""
    plain = [_file_name(name) for name in names]
    # Some file systems ignore case.
    often = Counter(each.lower() for each in plain)
    return [
        f"{each}-{sha256(name.encode()).hexdigest()[:8]}" if often[each.lower()] > 1 else each
        for name, each in zip(names, plain, strict=True)
    ]


def _file_name(name: str) -> str:
    """Replace what could leave the folder: a table's name contains the name of a data set."""
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in name)[:80]


def task_graphs(rows: Sequence[ResultRow]) -> Iterator[ReportFigure]:
    """Yield the dependency graphs of the shipped tasks that were played, from shipped plans."""
    own = [row for row in rows if row.pack.name == OURS]
    shipped = set(task_names())
    for dataset, group in datasets(own).items():
        for task in tasks(group):
            name = task if "/" in task else f"{dataset}/{task}"
            if name not in shipped:
                continue  # The search for similar names would take 10 ms for each of them.
            try:
                world = World(load_task(name, files=False))
            except RobotouilleError:
                continue  # This version does not have the task.
            plan = plan_beside(world)
            if plan is not None:
                yield draw_graph(f"graph_{name.replace('/', '_')}", dependency_graph(world, plan))


def write_parquet(rows: Sequence[ResultRow], path: Path) -> None:
    """Write rows as Parquet, one column for each number. Equal rows give equal bytes.

    Raises:
        OSError: The file cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    # A column without values keeps its type, so that files can be concatenated.
    types = {
        bool: pa.bool_(),
        int: pa.int64(),
        float: pa.float64(),
        str: pa.string(),
        Category: pa.string(),
        tuple[Number, ...]: pa.list_(pa.int64()),
        dict[Name, Measure]: pa.map_(pa.string(), pa.float64()),
    }
    schema = pa.schema([(name, types[kind]) for name, kind in _columns(ResultRow)])
    with whole_file(path, text=False) as file, pq.ParquetWriter(file, schema) as writer:
        for begin in range(0, len(rows), ROW_GROUP):
            cells = [dict(_cells(row)) for row in rows[begin : begin + ROW_GROUP]]
            writer.write_table(pa.Table.from_pylist(cells, schema=schema))


def _columns(model: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield names and types. Nested fields are flattened: `outcome.steps` is `outcome_steps`."""
    for name, field in model.model_fields.items():
        kind = _bare(field.annotation)
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from _columns(kind, f"{prefix}{name}_")
        else:
            yield prefix + name, kind


def _bare(annotation: object) -> Any:
    """Return the type without `None` and without constraints."""
    if get_origin(annotation) in (Union, UnionType):
        (annotation,) = (part for part in get_args(annotation) if part is not type(None))
    if get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    return annotation


def _cells(part: BaseModel, prefix: str = "") -> Iterator[tuple[str, object]]:
    for name in type(part).model_fields:
        value = getattr(part, name)
        if isinstance(value, BaseModel):
            yield from _cells(value, f"{prefix}{name}_")
        else:
            yield prefix + name, value
