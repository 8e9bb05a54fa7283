"""`robotouille benchmark report|compare|agreement`: what came of runs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from robotouille.errors import RobotouilleError
from robotouille.program import tell
from robotouille_client.console import failing

if TYPE_CHECKING:
    from robotouille_evaluation.metrics.rows import EpisodeRow, Pair

__all__ = ["agreement", "compare", "report", "write_page"]


@failing
def report(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs.")],
    out: Annotated[Path, typer.Option(help="Where the report goes.")] = Path("report"),
) -> None:
    """Write tables, figures and one HTML page of runs."""
    rows, folders = _rows_of(runs)
    if not rows:
        raise RobotouilleError("no episode of these runs is over")
    tell(str(write_page(rows, out, folders)))


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
    from robotouille_evaluation.metrics.intervals import mcnemar_test, permutation_test
    from robotouille_evaluation.metrics.outcomes import succeeded

    rows, _ = _rows_of(runs)
    rows = _of_variant(rows, variant)
    of_first, of_second = (_of_agent(rows, name) for name in (first, second))
    found = [(of_first[pair], of_second[pair]) for pair in of_first if pair in of_second]
    if not found:
        raise RobotouilleError(
            f"{first} and {second} have no episode in common: {_why_apart(of_first, of_second)}"
        )
    mine, theirs = zip(*found, strict=True)
    won = [[succeeded(row) for row in rows] for rows in (mine, theirs)]
    steps = [[row.outcome.steps for row in rows] for rows in (mine, theirs)]
    p, p_steps = mcnemar_test(*won), permutation_test(*steps)
    result = {
        "episodes": len(found),
        first: sum(won[0]),
        second: sum(won[1]),
        "p": p,
        "mean_steps": {first: fmean(steps[0]), second: fmean(steps[1]), "p": p_steps},
    }
    tell(json.dumps(result) if json_output else
         f"{len(found)} episodes: {first} solves {sum(won[0])}, {second} {sum(won[1])}; "
         f"p {_p_value(p)} (McNemar, exact). Mean steps {fmean(steps[0]):.1f} and "
         f"{fmean(steps[1]):.1f}; p {_p_value(p_steps)} (permutation)")  # fmt: skip


def _p_value(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"= {p:.3f}"


@failing
def agreement(
    labels: Annotated[Path, typer.Argument(help="People's labels of failures: CSV or JSON.")],
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs.")],
) -> None:
    """Compare why episodes failed, as people have labelled it, with what the classifier says."""
    from robotouille_evaluation.metrics.labels import agreement as measured
    from robotouille_evaluation.metrics.labels import paired, read_labels

    rows, _ = _rows_of(runs)
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


def _rows_of(runs: Sequence[Path]) -> tuple[list[EpisodeRow], dict[str, Path]]:
    """The rows of all runs, and where each run lies. Runs of one name are called by their folders
    then."""
    from robotouille_evaluation.runs import RunFolder

    found = {path: RunFolder(path).rows() for path in dict.fromkeys(runs)}
    names = Counter(name for rows in found.values() for name in {row.run for row in rows})
    all_rows, folders = [], {}
    for path, rows in found.items():
        for row in rows:
            name = row.run if names[row.run] == 1 else str(path)
            all_rows.append(row.model_copy(update={"run": name}))
            folders[name] = path
    return all_rows, folders


def _of_variant(rows: Sequence[EpisodeRow], wanted: str | None) -> list[EpisodeRow]:
    """The rows of one variant: results of different ones do not compare."""
    if wanted is not None:
        return [row for row in rows if (row.variant or "none") == wanted]
    names = sorted({row.variant or "none" for row in rows})
    if len(names) > 1:
        choice = " or ".join(f"--variant {name}" for name in names)
        raise RobotouilleError(f"the runs are of several variants; name one: {choice}")
    return list(rows)


def _of_agent(rows: Sequence[EpisodeRow], name: str) -> dict[Pair, EpisodeRow]:
    """The rows of an agent; its model need not be named where there is one agent of the name."""
    agents = sorted({row.agent for row in rows})
    meant = [name] if name in agents else [a for a in agents if a.startswith(f"{name} (")]
    if len(meant) != 1:
        known = ", ".join(meant or agents)
        wrong = f"is one of several: {known}" if meant else f"has no episode; there are {known}"
        raise RobotouilleError(f"{name} {wrong}")
    return {row.pair: row for row in rows if row.agent == meant[0]}


def _why_apart(one: Iterable[Pair], other: Iterable[Pair]) -> str:
    """In what all episodes of one differ from all of another."""
    told = []
    for field in next(iter(one))._fields:
        mine, theirs = ({str(getattr(pair, field) or "none") for pair in each}
                        for each in (one, other))  # fmt: skip
        if not mine & theirs:
            told.append(f"{field} {_some(mine)} and {_some(theirs)}")
    return "; ".join(told) or "none is of the same instance, seed and terms"


def _some(words: Iterable[str]) -> str:
    ordered = sorted(words)
    return " or ".join(ordered[:3]) + (" or others" if len(ordered) > 3 else "")


def write_page(
    rows: Sequence[EpisodeRow], out: Path, folders: Mapping[str, Path] | None = None
) -> Path:
    """A report of rows; its page. `folders` say where each run lies, by its name.

    Raises:
        RobotouilleError: It cannot be written.
    """
    from robotouille_evaluation.report import write_report

    try:
        return write_report(rows, out, folders=folders)
    except OSError as error:
        raise RobotouilleError(
            f"{out}: the report cannot be written: {error.strerror}; the rows are kept, and "
            "`robotouille benchmark report` makes it of them"
        ) from None
