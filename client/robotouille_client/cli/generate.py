"""`robotouille generate TASK`: new instances of a task, each proven solvable."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from robotouille.generation.generator import ATTEMPTS, Generator
from robotouille.generation.instance import Instance
from robotouille.generation.paper_instances import seeds_from
from robotouille.generation.parameters import GenerationError, Kind, Parameters
from robotouille.program import printable_json, tell
from robotouille_client.console import fail, failing, interruptible

__all__ = ["generate"]

STDOUT = "-"

FLAGS = {"width": "size", "height": "size", "min_steps": "min-steps", "max_steps": "max-steps"}
"""The options that are not called like their parameters."""


@interruptible
@failing
def generate(
    task: Annotated[str, typer.Argument(help="Task name or problem file.")],
    seed: Annotated[int, typer.Option(help="Decides everything that is drawn.")] = 42,
    kind: Annotated[
        Kind, typer.Option(help="free: everything anywhere; noisy: the task's plans still work.")
    ] = Kind.FREE,
    count: Annotated[
        int,
        typer.Option(help="How many, with the seeds SEED, 2 SEED, 3 SEED, …", min=1, max=10_000),
    ] = 1,
    stations: Annotated[
        int | None, typer.Option(help="Irrelevant stations to add; 2 to 4 if not given.")
    ] = None,
    items: Annotated[
        int | None, typer.Option(help="Irrelevant items to add; 2 to 4 if not given.")
    ] = None,
    stacking: Annotated[
        bool | None,
        typer.Option(help="Whether items may lie on one another; only in free ones if not given."),
    ] = None,
    held: Annotated[
        bool, typer.Option("--held", help="Players may hold something at the start.")
    ] = False,
    size: Annotated[
        str | None, typer.Option(help="WIDTHxHEIGHT in tiles; the task's, or more if needed.")
    ] = None,
    min_steps: Annotated[
        int | None, typer.Option(help="The least number of steps of a shortest plan.")
    ] = None,
    max_steps: Annotated[
        int | None, typer.Option(help="The greatest number of steps of a shortest plan.")
    ] = None,
    attempts: Annotated[int, typer.Option(help="How often to draw for one seed.")] = ATTEMPTS,
    out: Annotated[str, typer.Option(help="Folder of the files; - for standard output.")] = ".",
    json_output: Annotated[
        bool, typer.Option("--json", help="Print a JSON line for each file.")
    ] = False,
) -> None:
    """Make new instances of a task from a seed, each proven solvable.

    The same seed and options give the same file on every machine.
    """
    from robotouille import load_task
    from robotouille.world.lint import sound_task

    if out == STDOUT and (count > 1 or json_output):
        fail("--out - is for one instance without --json")
    if seed == 0 and count > 1:
        fail("--seed: several instances have multiples of a seed, which has to be 1 or more")
    with _told_by_option():
        parameters = Parameters(*_size(size), stations, items, stacking, held, min_steps, max_steps)
        generator = Generator(sound_task(load_task(task)), kind, parameters, attempts=attempts)
        for instance in _progress(generator, seeds_from(seed, count), task):
            if out == STDOUT:
                typer.echo(printable_json(instance.text), nl=False)
            else:
                row = _row(instance, _write(instance, Path(out)))
                typer.echo(json.dumps(row)) if json_output else tell(_words(row))


@contextmanager
def _told_by_option() -> Iterator[None]:
    """Errors in a line: the option that cannot be met comes first."""
    try:
        yield
    except GenerationError as error:
        fail(f"{FLAGS.get(error.parameter, error.parameter)}: {error.message}")
    except OSError as error:
        fail(f"{error.filename}: cannot be written: {error.strerror}")


def _size(text: str | None) -> tuple[int | None, int | None]:
    if text is None:
        return None, None
    match = re.fullmatch(r"([0-9]{1,6})x([0-9]{1,6})", text)
    if match is None:
        raise GenerationError("size", f"expected WIDTHxHEIGHT like 6x5, found {text!r}")
    return int(match[1]), int(match[2])


def _progress(generator: Generator, seeds: tuple[int, ...], what: str) -> Iterator[Instance]:
    """The instances of some seeds, with a progress bar on a terminal."""
    from robotouille_client.console.progress import tracked

    for seed in tracked(seeds, what):
        yield generator.instance(seed)


def _write(instance: Instance, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{instance.name}.json"
    if path.exists() and path.read_text(encoding="utf-8") != instance.text:
        raise GenerationError("out", f"{path} is another instance; choose another folder")
    path.write_text(instance.text, encoding="utf-8", newline="\n")
    return path


def _row(instance: Instance, path: Path) -> dict[str, Any]:
    plans = instance.results.items()
    return {
        "file": str(path),
        "source": instance.provenance.source,
        "seed": instance.provenance.seed,
        "kind": instance.provenance.kind,
        "attempt": instance.provenance.attempt,
        "steps": {str(seats): len(result.plan or ()) for seats, result in plans},
        "optimal": {str(seats): result.optimal for seats, result in plans},
    }


def _words(row: dict[str, Any]) -> str:
    steps = ", ".join(
        f"{number} steps" + (f" with {seats} players" if len(row["steps"]) > 1 else "")
        for seats, number in row["steps"].items()
    )
    return f"{row['file']}  {row['kind']}, attempt {row['attempt']}; solved in {steps}"
