"""`robotouille benchmark report|compare|agreement`: results of runs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from robotouille.errors import FileError, RobotouilleError
from robotouille.terminal import tell
from robotouille_client.console import failing

if TYPE_CHECKING:
    from robotouille_evaluation.metrics.rows import Pair, ResultRow
    from robotouille_evaluation.packs.pack import FigureData


@failing
def report(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs.")],
    out: Annotated[Path, typer.Option(help="Folder of the report.")] = Path("report"),
    published: Annotated[
        Path | None,
        typer.Option(
            help="Imported pack whose published results stand next to those of the runs. "
            "Default: the pack of the runs, else the numbers that the paper prints."
        ),
    ] = None,
) -> None:
    """Write tables, figures and an HTML page about runs."""
    rows, folders = _rows_of(runs)
    if not rows:
        raise RobotouilleError("these runs have no finished episode")
    figures = _published_figures(folders.values(), published)
    tell(str(write_page(rows, out, folders, figures)))


def _published_figures(runs: Iterable[Path], published: Path | None) -> tuple[FigureData, ...]:
    """Return the published results of a pack, by default of the first of the runs' packs."""
    from robotouille_evaluation.packs.store import read_pack
    from robotouille_evaluation.runs import RunFolder

    if published is not None:
        found = read_pack(published).figures
        if not found:
            raise RobotouilleError(
                f"{published} has no published results; import it again from a checkout that has "
                "the notebook figures.ipynb"
            )
        return found
    for run in runs:
        with suppress(FileError):  # A report needs no pack, which may be elsewhere by now.
            if figures := read_pack(Path(RunFolder(run).plan().pack_folder)).figures:
                return figures
    return ()


@failing
def compare(
    first: Annotated[str, typer.Argument(help="Name of an agent.")],
    second: Annotated[str, typer.Argument(help="Name of another agent.")],
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs.")],
    variant: Annotated[
        Literal["none", "stochastic", "stochastic-paper", "delay-free"] | None,
        typer.Option(help="Variant, if the runs have several."),
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Compare two agents on the episodes that both have played."""
    rows, _ = _rows_of(runs)
    rows = _of_variant(rows, variant)
    of_first, of_second = (_of_agent(rows, name) for name in (first, second))
    # In one order, because drawn swaps of a permutation test depend on it.
    both = sorted(of_first.keys() & of_second.keys(), key=str)
    found = [(of_first[pair], of_second[pair]) for pair in both]
    if not found:
        raise RobotouilleError(
            f"{first} and {second} have no episode in common: {_why_apart(of_first, of_second)}"
        )
    # A shift that failed before its first step has no points to compare.
    shifts = [pair for pair in map(_with_score, found) if all(pair)]
    goals = [pair for pair in found if not pair[0][0].is_shift]
    result: dict[str, Any] = {"episodes": len(found)}
    lines = []
    if goals:
        words, more = _compared_goals(first, second, goals)
        lines, result = [words], result | more
    if shifts:
        words, points = _compared_shifts(first, second, shifts)
        lines, result = [*lines, words], result | {"mean_points": points}
    tell(json.dumps(result) if json_output else "\n".join(lines))


RowPair = tuple[list["ResultRow"], list["ResultRow"]]
"""Results of two agents under the same conditions; several, if an episode was played again."""


def _with_score(pair: RowPair) -> RowPair:
    mine, theirs = ([row for row in rows if row.score is not None] for rows in pair)
    return mine, theirs


def _count(pairs: Sequence[RowPair], what: str) -> str:
    repeated = any(len(rows) > 1 for pair in pairs for rows in pair)
    return f"{len(pairs)} {what}{', by the means of repeated ones' if repeated else ''}"


def _compared_goals(
    first: str, second: str, pairs: Sequence[RowPair]
) -> tuple[str, dict[str, Any]]:
    from robotouille_evaluation.metrics.outcomes import succeeded
    from robotouille_evaluation.metrics.statistics import permutation_test, success_test

    agents = list(zip(*pairs, strict=True))
    won = [[fmean(map(succeeded, rows)) for rows in agent] for agent in agents]
    steps = [[fmean(row.outcome.steps for row in rows) for rows in agent] for agent in agents]
    (p, test), p_steps = success_test(*won), permutation_test(*steps)
    mine, theirs = (int(total) if total % 1 == 0 else total for total in map(sum, won))
    words = (
        f"{_count(pairs, 'episodes')}: {first} solves {mine:.10g}, {second} {theirs:.10g}; "
        f"p {_p_value(p)} ({test}). Mean steps {fmean(steps[0]):.1f} and "
        f"{fmean(steps[1]):.1f}; p {_p_value(p_steps)} (permutation)"
    )
    means = {first: fmean(steps[0]), second: fmean(steps[1]), "p": p_steps}
    return words, {first: mine, second: theirs, "p": p, "mean_steps": means}


def _compared_shifts(
    first: str, second: str, pairs: Sequence[RowPair]
) -> tuple[str, dict[str, float]]:
    from robotouille_evaluation.metrics.statistics import permutation_test

    mine, theirs = ([fmean(row.score.points for row in rows if row.score) for rows in agent]
                    for agent in zip(*pairs, strict=True))  # fmt: skip
    p = permutation_test(mine, theirs)
    words = (
        f"{_count(pairs, 'shifts')}: mean points {fmean(mine):.1f} of {first} and "
        f"{fmean(theirs):.1f} of {second}; p {_p_value(p)} (permutation)"
    )
    return words, {first: fmean(mine), second: fmean(theirs), "p": p}


def _p_value(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"= {p:.3f}"


@failing
def agreement(
    labels: Annotated[
        Path | None, typer.Argument(help="Failure labels by people: CSV or JSON.")
    ] = None,
    runs: Annotated[
        list[Path] | None, typer.Argument(metavar="RUN...", help="Folders of runs.")
    ] = None,
) -> None:
    """Compare people's failure labels with the classifier's.

    Without arguments, the labels are those of the failures that the paper logs.
    """
    from robotouille_evaluation.metrics.statistics import agreement as measured
    from robotouille_evaluation.metrics.statistics import paired, read_labels

    if labels is None:
        _paper_agreement()
        return
    if not runs:
        raise RobotouilleError(f"{labels} has labels of episodes: name their runs, too")
    rows, _ = _rows_of(runs)
    pairs = paired(rows, read_labels(labels))
    if not pairs:
        raise RobotouilleError(
            f"{labels} has no label of a failed episode of these runs; "
            "its `recording` must be as in the rows"
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
    value = "undefined, because all labels are equal" if kappa is None else f"{kappa:.2f}"
    tell(f"{len(pairs)} episodes; Cohen's kappa {value}")


def _paper_agreement() -> None:
    """Print the agreement with the paper's authors on the failures that they log."""
    from robotouille_evaluation.metrics.paper_failures import logged_failures
    from robotouille_evaluation.metrics.statistics import cohens_kappa

    found = logged_failures()
    for each in found:
        tell(f"{each.log}: {each.labelled}, classified as {each.classified}")
    kappa = cohens_kappa([each.labelled for each in found], [each.classified for each in found])
    equal = sum(each.labelled is each.classified for each in found)
    tell(
        f"{equal} of {len(found)} equal; Cohen's kappa {kappa:.2f}. These are all labels that the "
        "paper prints, on episodes rebuilt from its excerpts: too few to judge the classifier"
    )


def _rows_of(runs: Sequence[Path]) -> tuple[list[ResultRow], dict[str, Path]]:
    """Return the rows and folders of all runs; runs with equal names are named by path."""
    from robotouille_evaluation.runs import RunFolder

    found = {path: RunFolder(path).rows() for path in dict.fromkeys(runs)}
    names = Counter(name for rows in found.values() for name in {row.run for row in rows})
    all_rows, folders = [], {}
    for path, rows in found.items():
        for row in rows:
            named = row if names[row.run] == 1 else row.model_copy(update={"run": str(path)})
            all_rows.append(named)
            folders[named.run] = path
    return all_rows, folders


def _of_variant(rows: Sequence[ResultRow], wanted: str | None) -> list[ResultRow]:
    """Return the rows of one variant, because results of different ones are not comparable."""
    if wanted is not None:
        return [row for row in rows if (row.variant or "none") == wanted]
    names = sorted({row.variant or "none" for row in rows})
    if len(names) > 1:
        choice = " or ".join(f"--variant {name}" for name in names)
        raise RobotouilleError(f"the runs have several variants; choose one: {choice}")
    return list(rows)


def _of_agent(rows: Sequence[ResultRow], name: str) -> dict[Pair, list[ResultRow]]:
    """Return the rows of an agent by pair. Its model may be omitted if the name is unambiguous."""
    from robotouille_evaluation.metrics.statistics import by_pair

    agents = sorted({row.agent for row in rows})
    meant = [name] if name in agents else [a for a in agents if a.startswith(f"{name} (")]
    if len(meant) != 1:
        known = ", ".join(meant or agents)
        wrong = "is ambiguous; choose" if meant else "has no episode; choose"
        raise RobotouilleError(f"{name!r} {wrong} {known}")
    return by_pair(row for row in rows if row.agent == meant[0])


def _why_apart(one: Iterable[Pair], other: Iterable[Pair]) -> str:
    """Return the fields in which all episodes of one agent differ from all of the other."""
    found = []
    for field in next(iter(one))._fields:
        mine, theirs = ({str(getattr(pair, field) or "none") for pair in each}
                        for each in (one, other))  # fmt: skip
        if not mine & theirs:
            found.append(f"{field} {_some(mine)} and {_some(theirs)}")
    return "; ".join(found) or "no two have the same instance, seed and conditions"


def _some(words: Iterable[str]) -> str:
    ordered = sorted(words)
    return " or ".join(ordered[:3]) + (" or others" if len(ordered) > 3 else "")


def write_page(
    rows: Sequence[ResultRow],
    out: Path,
    folders: Mapping[str, Path] | None = None,
    figures: Sequence[FigureData] = (),
) -> Path:
    """Write a report and return its page.

    Args:
        folders: Folders of runs by name.
        figures: Published results of an imported pack.

    Raises:
        RobotouilleError: The report cannot be written.
    """
    from robotouille_evaluation.report import write_report

    try:
        return write_report(rows, out, folders=folders, figures=figures)
    except OSError as error:
        raise RobotouilleError(
            f"{out}: the report cannot be written: {error.strerror}; the rows are kept, so "
            "`robotouille benchmark report` can write it later"
        ) from None
