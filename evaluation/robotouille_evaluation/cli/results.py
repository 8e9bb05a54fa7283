"""`robotouille benchmark report|compare|agreement`: what came of runs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from robotouille.errors import RobotouilleError
from robotouille.program import tell
from robotouille_client.console import failing

if TYPE_CHECKING:
    from robotouille_evaluation.metrics.rows import EpisodeRow

__all__ = ["agreement", "compare", "report", "write_page"]


@failing
def report(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs.")],
    out: Annotated[Path, typer.Option(help="Where the report goes.")] = Path("report"),
) -> None:
    """Write tables, figures and one HTML page of runs."""
    from robotouille_evaluation.runs import RunFolder

    rows = [row for path in runs for row in RunFolder(path).rows()]
    if not rows:
        raise RobotouilleError("no episode of these runs is over")
    tell(str(write_page(rows, out)))


@failing
def compare(
    first: Annotated[str, typer.Argument(help="The name of an agent.")],
    second: Annotated[str, typer.Argument(help="The name of another.")],
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs.")],
    variant: Annotated[
        Literal["none", "stochastic", "delay-free"] | None,
        typer.Option(help="Of which variant, where the runs are of several."),
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Compare two agents on the episodes that both have played, pair by pair."""
    from robotouille_evaluation.metrics.intervals import mcnemar_test
    from robotouille_evaluation.runs import RunFolder

    rows = [row for path in runs for row in RunFolder(path).rows()]
    rows = _of_variant(rows, variant)
    pairs = [(a.outcome.success, b.outcome.success) for a, b in _paired(rows, first, second)]
    if not pairs:
        names = ", ".join(sorted({row.agent for row in rows}))
        raise RobotouilleError(f"{first} and {second} have no episode in common; there are {names}")
    p = mcnemar_test(*zip(*pairs, strict=True))
    found = {
        "episodes": len(pairs),
        first: sum(a for a, _ in pairs),
        second: sum(b for _, b in pairs),
        "p": p,
    }
    tell(json.dumps(found) if json_output else
         f"{len(pairs)} episodes: {first} solves {found[first]}, {second} {found[second]}; "
         f"p = {p:.3f} (McNemar, exact)")  # fmt: skip


@failing
def agreement(
    labels: Annotated[Path, typer.Argument(help="People's labels of failures: CSV or JSON.")],
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs.")],
) -> None:
    """Compare why episodes failed, as people have labelled it, with what the classifier says."""
    from robotouille_evaluation.metrics.labels import agreement as measured
    from robotouille_evaluation.metrics.labels import paired, read_labels
    from robotouille_evaluation.runs import RunFolder

    rows = [row for path in runs for row in RunFolder(path).rows()]
    pairs = paired(rows, read_labels(labels))
    if not pairs:
        raise RobotouilleError(
            f"{labels} labels no failed episode of these runs; `recording` has to be as in the rows"
        )
    for row, label in pairs:
        if row.measures.failure and row.measures.failure.category != label.category:
            found = row.measures.failure
            steps = ", ".join(map(str, found.steps)) or "none"
            tell(
                f"{label.recording}: {label.category}, classified as {found.category} "
                f"({found.subcategory}; steps {steps})"
            )
    kappa = measured([row for row, _ in pairs], [label for _, label in pairs])
    said = "not defined: all labels are the same" if kappa is None else f"{kappa:.2f}"
    tell(f"{len(pairs)} episodes; Cohen's kappa {said}")


def _of_variant(rows: Sequence[EpisodeRow], wanted: str | None) -> list[EpisodeRow]:
    """The rows of one variant: results of different ones do not compare."""
    if wanted is not None:
        return [row for row in rows if (row.variant or "none") == wanted]
    names = sorted({row.variant or "none" for row in rows})
    if len(names) > 1:
        raise RobotouilleError(f"the runs are of several variants; name one: --variant {names}")
    return list(rows)


def _paired(
    rows: Sequence[EpisodeRow], first: str, second: str
) -> list[tuple[EpisodeRow, EpisodeRow]]:
    found: dict[str, dict[object, EpisodeRow]] = {first: {}, second: {}}
    for row in rows:
        if row.agent in found:
            found[row.agent][row.pair] = row
    return [(found[first][pair], found[second][pair]) for pair in found[first]
            if pair in found[second]]  # fmt: skip


def write_page(rows: Sequence[EpisodeRow], out: Path) -> Path:
    """A report of rows; its page. RobotouilleError if it cannot be written."""
    from robotouille_evaluation.report import write_report

    try:
        return write_report(rows, out)
    except OSError as error:
        raise RobotouilleError(
            f"{out}: the report cannot be written: {error.strerror}; the rows are kept, and "
            "`robotouille benchmark report` makes it of them"
        ) from None
