"""`robotouille replay …`: look at, verify, watch and export recordings."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from robotouille.errors import RobotouilleError
from robotouille.replay.export import json_lines
from robotouille.replay.recording import Recording, read_recording
from robotouille_client.cli.console import fail

__all__ = ["replay"]

replay = typer.Typer(no_args_is_help=True, help="Look at, verify, watch and export recordings.")

FileArgument = Annotated[Path, typer.Argument(help="A recording (.rbt, or .rbt.part while open).")]


def _open(file: Path) -> Recording:
    try:
        return read_recording(file)
    except RobotouilleError as error:
        fail(str(error))


@replay.command()
def info(
    file: FileArgument,
    json_output: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Say what was played, by whom, and how it ended."""
    recording = _open(file)
    head = recording.header
    rows = {
        "task": head["task"]["name"],
        "goal": head["task"]["problem"].get("goal_description", ""),
        "clock": head["rules"]["clock"],
        "timing": head["task"]["timing"],
        "seed": head["seed"],
        "created": head["created"],
        "software": head["software"],
        "seats": {p: f"{name} ({kind})" for p, (name, kind) in recording.participants.items()},
        "steps": len(recording.steps),
        "outcome": recording.outcome,
    }
    if json_output:
        typer.echo(json.dumps(rows))
        return
    end = recording.outcome
    rows["seats"] = ", ".join(f"{player}: {who}" for player, who in rows["seats"].items())
    rows["outcome"] = f"{end['reason']} after {end['seconds']} s" if end else "none: it was cut off"
    for key, value in rows.items():
        typer.echo(f"{key:9} {value}")


@replay.command()
def verify(files: Annotated[list[Path], typer.Argument(help="Recordings.")]) -> None:
    """Re-simulate recordings and compare every fact, timer and hash.

    Exit status 1 if any differs; says the first step and the first fact that do.
    """
    failed = False
    for file in files:
        try:
            result = read_recording(file).verify()
        except RobotouilleError as error:
            typer.echo(str(error), err=True)
            failed = True
            continue
        cut = "" if result.complete else " (the file was cut off before the end)"
        if result.ok:
            typer.echo(f"{file}: verified, {result.steps} steps{cut}")
        else:
            failed = True
            reason = result.fault or "the frames differ when written anew"
            typer.echo(f"{file}: does NOT verify: {reason}{cut}", err=True)
    if failed:
        raise typer.Exit(1)


@replay.command()
def export(
    file: FileArgument,
    output: Annotated[
        Path | None, typer.Option(help="File to write; standard output else.")
    ] = None,
    texts: Annotated[bool, typer.Option(help="Add each seat's observation in words.")] = False,
) -> None:
    """Write a recording as JSON lines: header, steps, outcome."""
    recording = _open(file)
    try:
        lines = "".join(f"{line}\n" for line in json_lines(recording, texts=texts))
        if output is None:
            sys.stdout.write(lines)
        else:
            output.write_text(lines, encoding="utf-8")
    except (OSError, RobotouilleError) as error:
        fail(str(error))


@replay.command()
def play(
    file: FileArgument,
    speed: Annotated[float, typer.Option(help="Steps a second.", min=0.1, max=60)] = 5.0,
) -> None:
    """Watch a recording in a window: space pauses, left and right step."""
    from robotouille_client.window.theatre import watch

    try:
        watch(_open(file), speed)
    except RobotouilleError as error:
        fail(str(error))


@replay.command()
def video(
    file: FileArgument,
    output: Annotated[Path, typer.Argument(help="A file to write: .mp4 or .gif.")],
    speed: Annotated[float, typer.Option(help="Steps a second.", min=0.1, max=60)] = 4.0,
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "1280x720",
) -> None:
    """Write a recording as a video."""
    from robotouille_client.window.theatre import film

    try:
        frames = film(_open(file), output, speed, size)
    except RobotouilleError as error:
        fail(str(error))
    typer.echo(f"{output}: {frames} frames")
