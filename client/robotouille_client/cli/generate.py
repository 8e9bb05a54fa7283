"""Command `robotouille generate`: new instances of a task, each proven to have a solution."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from robotouille.errors import FileError
from robotouille.files.reading import read_bytes
from robotouille.files.writing import check_folder, replace_file
from robotouille.generation.generator import ATTEMPTS, MAX_ATTEMPTS, Generator, seeds_from
from robotouille.generation.instance import Instance
from robotouille.generation.parameters import GenerationError, Kind, Parameters
from robotouille.generation.shifts import generator_of
from robotouille.terminal import options_from, printable_json, tell
from robotouille_client.console import fail, failing, interruptible

STDOUT = "-"

FLAGS = {"width": "size", "height": "size", "min_steps": "min-steps", "max_steps": "max-steps"}
"""Options whose names differ from those of the parameters."""


@dataclass(frozen=True, kw_only=True)
class GenerateOptions:
    """Options of `robotouille generate`."""

    seed: Annotated[int, typer.Option(help="Seed of all random choices.")] = 42
    kind: Annotated[
        Kind,
        typer.Option(help="free: place everything anywhere. noisy: keep the task's plans valid."),
    ] = Kind.FREE
    count: Annotated[
        int,
        typer.Option(
            help="Number of instances, with the seeds SEED, 2 SEED, 3 SEED, …", min=1, max=10_000
        ),
    ] = 1
    stations: Annotated[
        int | None, typer.Option(help="Number of irrelevant stations to add. Default: 2 to 4.")
    ] = None
    items: Annotated[
        int | None, typer.Option(help="Number of irrelevant items to add. Default: 2 to 4.")
    ] = None
    stacking: Annotated[
        bool | None,
        typer.Option(help="Let items lie on other items. Default: only with --kind free."),
    ] = None
    held: Annotated[bool, typer.Option("--held", help="Let players hold items at the start.")] = (
        False
    )
    size: Annotated[
        str | None,
        typer.Option(help="WIDTHxHEIGHT in tiles. Default: the task's, or more if needed."),
    ] = None
    min_steps: Annotated[int | None, typer.Option(help="Minimum length of the shortest plan.")] = (
        None
    )
    max_steps: Annotated[int | None, typer.Option(help="Maximum length of the shortest plan.")] = (
        None
    )
    attempts: Annotated[
        int,
        typer.Option(
            help="Maximum number of kitchens to draw for one seed.", min=1, max=MAX_ATTEMPTS
        ),
    ] = ATTEMPTS
    out: Annotated[str, typer.Option(help="Folder for the files; - for standard output.")] = "."
    json_output: Annotated[
        bool, typer.Option("--json", help="Print one line of JSON for each file.")
    ] = False


@interruptible
@failing
@options_from(GenerateOptions)
def generate(
    task: Annotated[str, typer.Argument(help="Task name or problem file.")],
    options: GenerateOptions,
) -> None:
    """Make new instances of a task from a seed, and prove that each can be solved.

    The same seed and options give the same file on every machine.
    """
    from robotouille import load_task
    from robotouille.world.lint import sound_task

    out = options.out
    if out == STDOUT and (options.count > 1 or options.json_output):
        fail("--out - is for one instance without --json")
    if options.seed == 0 and options.count > 1:
        fail("--seed must be 1 or more for several instances, which use multiples of it")
    if out != STDOUT:
        check_folder(Path(out))
    with _errors_by_option():
        parameters = Parameters(
            *_size(options.size),
            options.stations,
            options.items,
            options.stacking,
            options.held,
            options.min_steps,
            options.max_steps,
        )
        generator = generator_of(
            sound_task(load_task(task)), options.kind, parameters, attempts=options.attempts
        )
        for instance in _progress(generator, seeds_from(options.seed, options.count), task):
            if out == STDOUT:
                typer.echo(printable_json(instance.text), nl=False)
            else:
                row = _row(instance, _write(instance, Path(out)))
                typer.echo(json.dumps(row)) if options.json_output else tell(_words(row))


@contextmanager
def _errors_by_option() -> Iterator[None]:
    """Print errors on one line that begins with the option at fault."""
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
    from robotouille_client.console.progress import tracked

    for seed in tracked(seeds, what):
        yield generator.instance(seed)


def _write(instance: Instance, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{instance.name}.json"
    if _differs(path, instance.text.encode()):
        raise GenerationError("out", f"{path} contains another instance; choose another folder")
    replace_file(path, instance.text)
    return path


def _differs(path: Path, content: bytes) -> bool:
    """Return whether there is a file with another content."""
    try:
        return read_bytes(path, len(content)) != content
    except FileNotFoundError:
        return False
    except FileError:
        return True  # The file is longer.


def _row(instance: Instance, path: Path) -> dict[str, Any]:
    plans, shift = instance.results.items(), instance.task.problem.shift
    proof: dict[str, Any] = {
        "steps": {str(seats): len(result.plan or ()) for seats, result in plans},
        "optimal": {str(seats): result.optimal for seats, result in plans},
    }
    if shift is not None:
        proof = {"points": {str(seats): points for seats, points in shift.planner.items()}}
    return {
        "file": str(path),
        "source": instance.provenance.source,
        "seed": instance.provenance.seed,
        "kind": instance.provenance.kind,
        "attempt": instance.provenance.attempt,
        **proof,
    }


def _words(row: dict[str, Any]) -> str:
    unit, result = ("points", "planner bots earn") if "points" in row else ("steps", "solved in")
    numbers = ", ".join(
        f"{number} {unit}" + (f" with {_players(seats)}" if len(row[unit]) > 1 else "")
        for seats, number in row[unit].items()
    )
    return f"{row['file']}  {row['kind']}, attempt {row['attempt']}; {result} {numbers}"


def _players(seats: str) -> str:
    return f"{seats} player" if seats == "1" else f"{seats} players"
