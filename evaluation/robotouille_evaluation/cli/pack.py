"""`robotouille pack`: import, build, show, check, prove and compare packs."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Console

from robotouille.errors import RobotouilleError
from robotouille.planning import solve
from robotouille.terminal import printable, tell
from robotouille_client.console import explain, fail, terminable
from robotouille_evaluation.cli.progress import bar_or_lines
from robotouille_evaluation.packs.built_in import BUILT_IN, find_pack
from robotouille_evaluation.packs.checking import (
    EXPANSIONS,
    KINDS,
    SECONDS,
    check_pack,
    prove_instances,
    with_instances,
)
from robotouille_evaluation.packs.differences import compare_packs, markdown_tables, text_tables
from robotouille_evaluation.packs.pack import Pack, PackInstance
from robotouille_evaluation.packs.published_checkout import read_checkout
from robotouille_evaluation.packs.store import default_folder, read_pack, write_pack

pack = typer.Typer(
    no_args_is_help=True,
    help="Import, build, check, prove and compare packs of tasks for the benchmark.",
)

SAVE_SECONDS = 60.0
"""Period for saving proofs."""

FolderArgument = Annotated[Path, typer.Argument(help="Folder of a pack.")]
PackArgument = Annotated[
    Path, typer.Argument(help=f"Folder of a pack, or a built-in one: {', '.join(BUILT_IN)}.")
]
OutOption = Annotated[
    Path | None, typer.Option("--out", help="Folder to write to. Default: packs/NAME.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]


@pack.command("import")
def import_(
    checkout: Annotated[Path, typer.Argument(help="Checkout of the published repository.")],
    out: OutOption = None,
    json_output: JsonOption = False,
) -> None:
    """Make a pack from a checkout of the published repository and generate its instances.

    Missing parts are listed, and the rest is imported. Exit status 1 if files are invalid.
    """
    with _errors(), bar_or_lines("instances") as progress:
        found = read_checkout(checkout, progress=progress)
        folder = _write(found.pack, out)
    if json_output:
        row = {"missing": list(found.missing), "faults": list(found.faults)}
        typer.echo(json.dumps({**_row(found.pack), "folder": str(folder), **row}, indent=2))
    else:
        _tell_pack(found.pack, folder)
        for name in found.missing:
            tell(printable(f"missing: {name}"), err=True)
        _tell_missing_tasks(found.pack)
        for fault in found.faults:
            tell(printable(f"invalid: {fault}"), err=True)
    if found.faults:
        raise typer.Exit(1)


def _tell_missing_tasks(found: Pack) -> None:
    """Print how many tasks of experiments the checkout lacks, if any."""
    named = {name for experiment in found.experiments for name in experiment.tasks}
    missing = {name for each in found.experiments for name in found.missing_tasks(each)}
    if missing:
        tell(
            f"The checkout lacks {len(missing)} of the {len(named)} tasks that its experiments "
            'name. Runs play the others; see "Missing tasks" in docs/packs.md',
            err=True,
        )


@pack.command()
def build(
    name: Annotated[
        Literal["ours", "shifts", "paper"],
        typer.Argument(
            help="The tasks with goals, the shifts, or tasks with instances drawn as in the paper."
        ),
    ] = "ours",
    out: OutOption = None,
    json_output: JsonOption = False,
) -> None:
    """Make a pack from the shipped tasks and their instances."""
    with _errors(), bar_or_lines("tasks") as progress:
        built = BUILT_IN[name](progress)
        folder = _write(built, out)
    if json_output:
        typer.echo(json.dumps({**_row(built), "folder": str(folder)}, indent=2))
    else:
        _tell_pack(built, folder)


@pack.command()
def show(pack: PackArgument, json_output: JsonOption = False) -> None:
    """Show the contents of a pack."""
    with _errors():
        found = find_pack(pack)
    if json_output:
        names = {
            "tasks": [{"task": task.name, "optimal": task.optimal} for task in found.tasks],
            "prompts": [prompt.id for prompt in found.prompts],
            "examples": [examples.name for examples in found.examples],
            "experiments": [experiment.id for experiment in found.experiments],
        }
        typer.echo(json.dumps({**_row(found), **names}, indent=2))
        return
    _tell_pack(found, pack)
    for task in found.tasks:
        instances = len(found.instances_of([task.name]))
        optimal = "" if task.optimal is None else f", {task.optimal} steps ({task.optimal_from})"
        tell(printable(f"  {task.name}: {instances} instances{optimal}"))
    for what, listed in (
        ("prompts", [prompt.id for prompt in found.prompts]),
        ("examples", [examples.name for examples in found.examples]),
        ("experiments", [experiment.id for experiment in found.experiments]),
    ):
        if listed:
            tell(printable(f"{what}: {', '.join(listed)}"))


@pack.command()
def check(pack: PackArgument, json_output: JsonOption = False) -> None:
    """Check the hashes, references, instances and plans of a pack.

    Exit status 1 if anything is invalid.
    """
    with _errors():
        found = find_pack(pack)
    with bar_or_lines("instances") as progress:
        faults = check_pack(found, progress)
    if json_output:
        typer.echo(json.dumps({**_row(found), "faults": faults}, indent=2))
    else:
        tell("\n".join(printable(fault) for fault in faults or ["no faults"]))
    if faults:
        raise typer.Exit(1)


@pack.command()
def prove(
    folder: FolderArgument,
    expansions: Annotated[
        int, typer.Option(min=1, help="Most expansions per instance.")
    ] = EXPANSIONS,
    timeout: Annotated[
        float,
        typer.Option(min=0.1, help="Most seconds per instance. Results depend on the machine."),
    ] = SECONDS,
) -> None:
    """Find shortest plans of the default and free instances, and store those that are proven.

    The pack gets a new digest. Proofs are written every minute, and when the command is interrupted
    (SIGINT, SIGTERM). The next `prove` continues.
    """
    with _errors(), terminable():
        found = read_pack(folder)
        proven: list[PackInstance] = []
        with suppress(KeyboardInterrupt), bar_or_lines("instances") as progress:
            written = time.monotonic()
            for instance in prove_instances(
                found, solve, expansions=expansions, seconds=timeout, progress=progress
            ):
                proven.append(instance)
                if time.monotonic() - written >= SAVE_SECONDS:
                    write_pack(with_instances(found, proven), folder)
                    written = time.monotonic()
        made = with_instances(found, proven)
        write_pack(made, folder)
    open_ones = sum(i.optimal() is None for i in made.instances_of(kinds=KINDS))
    tell(f"{len(proven)} proven now, {open_ones} without a proven plan")
    tell(f"digest {made.digest}")


@pack.command()
def diff(
    a: PackArgument,
    b: PackArgument,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print Markdown.")] = False,
    json_output: JsonOption = False,
) -> None:
    """Show the differences between two packs: goals, layouts, words, optima and budgets."""
    with _errors():
        found = compare_packs(find_pack(a), find_pack(b))
    if json_output:
        typer.echo(json.dumps(asdict(found), indent=2))
    elif found.none:
        tell("no difference")
    elif markdown:
        tell(markdown_tables(found), nl=False)
    else:
        console = Console(highlight=False)
        for table in text_tables(found):
            console.print(table)


def _write(made: Pack, out: Path | None) -> Path:
    folder = out or default_folder(made.name)
    write_pack(made, folder)
    return folder


def _row(found: Pack) -> dict[str, Any]:
    return {
        "name": found.name,
        "version": found.version,
        "digest": found.digest,
        "instances": dict(Counter(instance.kind for instance in found.instances)),
    }


def _tell_pack(found: Pack, folder: Path) -> None:
    kinds = Counter(instance.kind for instance in found.instances)
    counts = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
    tell(printable(f"{folder}: {found.name} {found.version}, {len(found.tasks)} tasks ({counts})"))
    tell(f"digest {found.digest}")


@contextmanager
def _errors() -> Iterator[None]:
    """Print errors on stderr, and exit with status 1, or 130 after an interruption."""
    try:
        yield
    except RobotouilleError as error:
        fail(explain(error))
    except KeyboardInterrupt:
        fail("interrupted; nothing was written", 130)
