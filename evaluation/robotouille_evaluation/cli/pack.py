"""`robotouille pack …`: import, build, look at, check and compare packs."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from robotouille.errors import RobotouilleError
from robotouille.planning import solve
from robotouille.program import printable, tell
from robotouille_client.console import explain, fail, terminable
from robotouille_client.console.progress import progress_bar
from robotouille_evaluation.packs.checking import check_pack
from robotouille_evaluation.packs.difference_tables import markdown_tables, text_tables
from robotouille_evaluation.packs.differences import compare_packs
from robotouille_evaluation.packs.own import NAME, build_own_pack
from robotouille_evaluation.packs.pack import Pack, PackInstance
from robotouille_evaluation.packs.proving import (
    EXPANSIONS,
    KINDS,
    SECONDS,
    prove_instances,
    with_instances,
)
from robotouille_evaluation.packs.published.checkout import read_checkout
from robotouille_evaluation.packs.store import default_folder, read_pack, write_pack

__all__ = ["pack"]

pack = typer.Typer(
    no_args_is_help=True,
    help="Packs of tasks to evaluate on: import the published one, build ours, compare them.",
)

SAVE_SECONDS, SAY_SECONDS = 60.0, 30.0
"""Between two writings of a pack that is being proven; between two lines where is no terminal."""

FolderArgument = Annotated[Path, typer.Argument(help="Folder of a pack.")]
OutOption = Annotated[
    Path | None, typer.Option("--out", help="Folder to write to; packs/NAME if not given.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]


@pack.command("import")
def import_(
    checkout: Annotated[Path, typer.Argument(help="A checkout of the published repository.")],
    out: OutOption = None,
    json_output: JsonOption = False,
) -> None:
    """Make a pack of a checkout of the published repository, its generated instances included.

    What the checkout has not is named, and the rest is imported. Exit status 1 if files are wrong.
    """
    with _errors(), _bar("instances") as progress:
        found = read_checkout(checkout, progress=progress)
        folder = _write(found.pack, out)
    if json_output:
        row = {"missing": list(found.missing), "faults": list(found.faults)}
        typer.echo(json.dumps({**_row(found.pack), "folder": str(folder), **row}, indent=2))
    else:
        _tell_pack(found.pack, folder)
        for name in found.missing:
            tell(printable(f"missing: {name}"), err=True)
        for fault in found.faults:
            tell(printable(f"wrong: {fault}"), err=True)
    if found.faults:
        raise typer.Exit(1)


@pack.command()
def build(out: OutOption = None, json_output: JsonOption = False) -> None:
    """Make a pack of the shipped tasks and their instances."""
    with _errors(), _bar("tasks") as progress:
        built = build_own_pack(progress)
        folder = _write(built, out)
    if json_output:
        typer.echo(json.dumps({**_row(built), "folder": str(folder)}, indent=2))
    else:
        _tell_pack(built, folder)


@pack.command()
def show(folder: FolderArgument, json_output: JsonOption = False) -> None:
    """Say what is in a pack."""
    with _errors():
        found = read_pack(folder)
    if json_output:
        names = {
            "tasks": [{"task": task.name, "optimal": task.optimal} for task in found.tasks],
            "prompts": [prompt.id for prompt in found.prompts],
            "examples": [examples.name for examples in found.examples],
            "experiments": [experiment.id for experiment in found.experiments],
        }
        typer.echo(json.dumps({**_row(found), **names}, indent=2))
        return
    _tell_pack(found, folder)
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
def check(folder: FolderArgument, json_output: JsonOption = False) -> None:
    """Check a pack: every hash, every reference, every instance as a world, and every plan in it.

    Exit status 1 if anything is wrong.
    """
    with _errors():
        found = read_pack(folder)
    with _bar("instances") as progress:
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
        int, typer.Option(min=1, help="Expansions that an instance may cost.")
    ] = EXPANSIONS,
    timeout: Annotated[
        float,
        typer.Option(min=0.1, help="Seconds for an instance; what it gives up depends on speed."),
    ] = SECONDS,
) -> None:
    """Find shortest plans of the default and free instances, and keep those that are proven.

    The pack gets another digest. What is proven is written every minute, and when the command is
    interrupted or ended (SIGINT, SIGTERM); the next run goes on.
    """
    with _errors(), terminable():
        found = read_pack(folder)
        proven: list[PackInstance] = []
        with suppress(KeyboardInterrupt), _bar("instances") as progress:
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
    tell(f"{len(proven)} proven now, {open_ones} have no proven plan")
    tell(f"digest {made.digest}")


@pack.command()
def diff(
    a: Annotated[str, typer.Argument(help=f"Folder of a pack, or `{NAME}` for the shipped one.")],
    b: Annotated[str, typer.Argument(help=f"Folder of another pack, or `{NAME}`.")],
    markdown: Annotated[bool, typer.Option("--markdown", help="Print Markdown.")] = False,
    json_output: JsonOption = False,
) -> None:
    """Say how two packs differ, task by task: goal, layout, words, optimum and budget."""
    with _errors():
        found = compare_packs(_pack(a), _pack(b))
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


def _pack(name: str) -> Pack:
    if name == NAME and not Path(name).is_dir():
        return build_own_pack()
    return read_pack(Path(name))


def _write(made: Pack, out: Path | None) -> Path:
    folder = out or default_folder(made.name)
    write_pack(made, folder)
    return folder


def _row(found: Pack) -> dict[str, Any]:
    """A pack in numbers."""
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
    """What goes wrong, on stderr and with exit status 1; 130 for an interruption."""
    try:
        yield
    except RobotouilleError as error:
        fail(explain(error))
    except KeyboardInterrupt:
        fail("interrupted; nothing was written", 130)


@contextmanager
def _bar(what: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on stderr; a line now and then, where that is no terminal."""
    terminal = Console(stderr=True).is_terminal
    said = time.monotonic()
    with progress_bar(what) as bar:

        def progress(done: int, total: int) -> None:
            nonlocal said
            bar(done, total)
            if not terminal and time.monotonic() - said >= SAY_SECONDS:
                tell(f"{done} of {total} {what}", err=True)
                said = time.monotonic()

        yield progress
