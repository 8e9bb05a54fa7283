"""`robotouille cross-play`: the matrix of all pairs of partners."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.errors import RobotouilleError
from robotouille.files.writing import check_file, replace_file
from robotouille.terminal import options_from, printable, tell
from robotouille_client.console import failing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robotouille.domain.task import Task
    from robotouille_evaluation.cross_play.matrix import CrossEpisode


@dataclass(frozen=True, kw_only=True)
class CrossPlayOptions:
    """Options of `robotouille cross-play`."""

    episodes: Annotated[int, typer.Option(min=1, help="Episodes of each pair.")] = 20
    seed: Annotated[int, typer.Option(help="Seed of all random decisions.")] = 0
    max_steps: Annotated[
        int, typer.Option(min=1, help="Longest episode. A shift ends by itself.")
    ] = 100
    out: Annotated[
        Path | None,
        typer.Option(help="File for the means (.csv) or for all episodes (.json)."),
    ] = None


@failing
@options_from(CrossPlayOptions)
def cross_play(
    task: Annotated[str, typer.Argument(help="A task with its seats, as in training/03@2.")],
    partners: Annotated[
        list[str],
        typer.Argument(
            metavar="PARTNER...",
            help="random, scripted, learner, partner, expert (planners with a skill), FILE.npz of "
            "robotouille-train, or MODULE:NAME of your own. NAME=PARTNER names it in the tables.",
        ),
    ],
    options: CrossPlayOptions,
) -> None:
    """Let all pairs of partners play a task, and print the means with 95 % intervals.

    Rows have the partner in the first seat, columns the partner in all other seats.
    """
    from robotouille_evaluation.cross_play.matrix import measures_of, play_pairs, text_table
    from robotouille_evaluation.cross_play.partners import partners_named

    _check_out(options.out)
    loaded = _team_task(task)
    population = partners_named(partners, loaded)
    _warn_of_slow_planners(partners)
    shift = loaded.problem.shift
    most = options.max_steps if shift is None else shift.steps * loaded.profile.delay_factor
    names, measures = [each.name for each in population], measures_of(loaded)

    def show(pair: Sequence[CrossEpisode]) -> None:
        found = ", ".join(f"{m.heading} {m.text(m.estimate(pair))}" for m in measures)
        tell(printable(f"{pair[0].first} with {pair[0].other}: {found}"), err=True)

    played = play_pairs(loaded, population, options.episodes, options.seed, most, show)
    for measure in measures:
        for line in text_table(played, names, measure).splitlines():
            tell(printable(line))
        tell("")
    if options.out is not None:
        _write(options.out, played, names, loaded, options.seed)


def _check_out(out: Path | None) -> None:
    if out is None:
        return
    if out.suffix not in (".csv", ".json"):
        raise RobotouilleError(f"--out: expected a file .csv or .json, found {out}")
    check_file(out)


def _team_task(name: str) -> Task:
    from robotouille.domain.loading import load_task
    from robotouille.world.world import World

    task = load_task(name)
    if len(World(task).players) < 2:
        raise RobotouilleError(f"cross-play needs two seats or more; {name} has one")
    return task


def _warn_of_slow_planners(partners: Sequence[str]) -> None:
    from robotouille.compiling import COMPILED
    from robotouille.planning.policies.skill import SKILLS

    if not COMPILED and not {*SKILLS}.isdisjoint(partners):
        tell(
            "planners search in plain Python, which is slow: pip install 'robotouille[fast]'",
            err=True,
        )


def _write(
    out: Path, played: Sequence[CrossEpisode], names: Sequence[str], task: Task, seed: int
) -> None:
    """Write the means as CSV, or all episodes as JSON."""
    from robotouille_evaluation.cross_play.matrix import csv_text, json_text, measures_of

    if out.suffix == ".csv":
        replace_file(out, csv_text(played, names, measures_of(task)))
    else:
        replace_file(out, json_text(played, task, seed))
