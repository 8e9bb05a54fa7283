"""`robotouille benchmark measure`: optimality and steps to go of episodes that were played."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.errors import RobotouilleError
from robotouille.terminal import printable, tell
from robotouille_client.console import failing, terminable

if TYPE_CHECKING:
    from robotouille_evaluation.metrics.rows import ResultRow
    from robotouille_evaluation.packs.pack import Pack
    from robotouille_evaluation.runs import RunFolder


@failing
def measure(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
    pack: Annotated[
        Path | None,
        typer.Option(
            help="Pack with the run's instances: a folder, or a built-in one. Default: the pack of "
            "the run, as it is now."
        ),
    ] = None,
    processes: Annotated[
        int, typer.Option(min=1, help="Processes that search for plans.")
    ] = os.cpu_count() or 1,
) -> None:
    """Measure optimality and steps to go of a played run, and write its report again.

    Optima are those that the pack knows now, for example after `robotouille pack prove`. Steps to
    go are searched from the last state of each recording, which can take longer than the run.
    Results are kept in the run, so a repeated command measures only what is new.
    """
    from robotouille_evaluation.cli.results import write_page
    from robotouille_evaluation.runs import RunFolder
    from robotouille_evaluation.runs.remeasure import lacks_measures

    folder = RunFolder(run)
    rows = folder.rows()
    if not rows:
        raise RobotouilleError(f"{run} has no finished episode")
    found = _pack_of(folder, pack)
    chosen = sorted(
        (row for row in rows if lacks_measures(row, found)),
        # Episodes of one instance follow each other, because they share a world.
        key=lambda row: (row.instance, row.seats),
    )
    faults = _measure(folder, chosen, found, processes)
    tell(_summary(folder.rows(), len(chosen) - len(faults)), err=True)
    tell(str(write_page(folder.rows(), run / "report", figures=found.figures)))
    if faults:
        more = f"; and {len(faults) - 1} more episodes" if len(faults) > 1 else ""
        raise RobotouilleError(f"{faults[0]}{more}: not measured")


def _pack_of(folder: RunFolder, chosen: Path | None) -> Pack:
    """Return the pack of a run, whatever its digest is by now."""
    from robotouille_evaluation.packs.built_in import find_pack
    from robotouille_evaluation.packs.store import read_pack

    if chosen is not None:
        return find_pack(chosen)
    if not folder.has_plan:
        raise RobotouilleError(
            f"{folder.path} has no run.json that names its pack: choose it with --pack, "
            "such as --pack ours"
        )
    return read_pack(Path(folder.plan().pack_folder))


def _measure(folder: RunFolder, rows: Sequence[ResultRow], pack: Pack, processes: int) -> list[str]:
    """Measure the rows, add them to the run, and return the reasons of those that failed."""
    from robotouille.planning.kitchen.kernels import announce_compiling
    from robotouille_evaluation.cli.progress import bar_or_lines
    from robotouille_evaluation.runs.remeasure import remeasure

    faults: list[str] = []
    if not rows:
        return faults
    announce_compiling()
    try:
        with folder.playing(), terminable(), bar_or_lines("episodes") as progress:
            progress(0, len(rows))
            results = remeasure(rows, pack, folder.path, min(processes, len(rows)))
            for number, result in enumerate(results, start=1):
                if result.row is None:
                    faults.append(printable(result.fault))
                else:
                    folder.add(result.row)
                progress(number, len(rows))
    except KeyboardInterrupt:
        raise RobotouilleError(
            f"stopped; `robotouille benchmark measure {folder.path}` measures the rest"
        ) from None
    return faults


def _summary(rows: Sequence[ResultRow], measured: int) -> str:
    """Return a line about the rows measured now and those that lack a measure."""
    from robotouille_evaluation.metrics.outcomes import with_goal

    goals = with_goal(rows)
    words = [f"{measured} of {len(rows)} episodes newly measured"]
    if lost := sum(row.recording is None for row in goals):
        words.append(f"{lost} have no recording")
    if unproven := sum(not row.optimum.proven for row in goals):
        words.append(f"{unproven} have no proven optimum (`robotouille pack prove`)")
    return "; ".join(words)
