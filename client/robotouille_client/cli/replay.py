"""`robotouille replay …`: look at, verify, measure, watch and export recordings."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from robotouille.certification.certificate import Deadline
from robotouille.domain.task import Timing
from robotouille.errors import RobotouilleError
from robotouille.planning.steps_to_go import Range, StepsLeft, quotient
from robotouille.program import printable, printable_json, tell
from robotouille.replay.analysis.distances import distances
from robotouille.replay.export import json_lines
from robotouille.replay.model_calls import call_texts
from robotouille.replay.notes import rejections
from robotouille.replay.recording import Recording, read_recording
from robotouille.replay.timeline import course, course_text, note_lines
from robotouille_client.console import (
    LenientOption,
    RenderingOption,
    check_look,
    explain,
    fail,
    failing,
    terminable,
)

__all__ = ["replay"]

replay = typer.Typer(
    no_args_is_help=True, help="Look at, verify, measure, watch and export recordings."
)

PATIENCE = 2.0
"""Seconds before progress is shown."""

FileArgument = Annotated[Path, typer.Argument(help="A recording (.rbt, or .rbt.part while open).")]
TasksOption = Annotated[
    Path | None,
    typer.Option(
        "--tasks", help="The folder of the kitchen's files, for its pictures; else the current one."
    ),
]
DamagedOption = Annotated[
    bool, typer.Option("--damaged", help="Of a damaged file, read what stands before the damage.")
]


def _open(file: Path, *, damaged: bool = False) -> Recording:
    try:
        recording = read_recording(file, damaged=damaged)
    except RobotouilleError as error:
        fail(explain(error))
    _tell_damage(file, recording)
    return recording


def _open_shown(file: Path, tasks: Path | None) -> Recording:
    """A recording that is to be drawn, damaged or not."""
    from robotouille_client.window.replay.history.recorded_look import open_shown

    if tasks is not None and not tasks.is_dir():
        raise RobotouilleError(f"--tasks {tasks}: there is no such folder")
    recording = open_shown(file, tasks, damaged=True)
    if tasks is not None and recording.task.folder != tasks:
        name = recording.task.domain.name
        tell(f"--tasks {tasks}: has no rendering of the domain {name!r}", err=True)
    _tell_damage(file, recording)
    return recording


def _tell_damage(file: Path, recording: Recording) -> None:
    if recording.damage:
        read = f"the {recording.length} steps before it are read"
        tell(printable(f"{file}: {recording.damage}; {read}"), err=True)


@replay.command()
@failing
def info(
    file: FileArgument,
    json_output: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    damaged: DamagedOption = False,
) -> None:
    """Say what was played, by whom in which steps, when it stood still, and how it ended."""
    recording = _open(file, damaged=damaged)
    head, seats = recording.header, recording.measures().seats
    rows = {
        "task": head["task"]["name"],
        "goal": head["task"]["problem"].get("goal_description", ""),
        "clock": head["rules"]["clock"],
        "timing": head["task"]["timing"],
        "seed": head["seed"],
        "created": head["created"],
        "software": head["software"],
        "labels": head.get("labels", {}),
        "treated": head.get("treatments", {}),
        "seats": {p: f"{name} ({kind})" for p, (name, kind) in recording.participants.items()},
        "steps": recording.length,
        "rejected": {p: dict(sorted(kinds.items())) for p, kinds in rejections(recording).items()},
        "activities": {player: seat.activities for player, seat in seats.items()},
        "staleness": {player: seat.staleness for player, seat in seats.items()},
        "outcome": recording.outcome,
    }
    if json_output:
        names = {key: head.get(key, "") for key in ("episode", "code", "owner")}
        typer.echo(json.dumps({**rows, **names, **course(recording)}))
        return
    end = recording.outcome
    rows["seats"] = ", ".join(f"{player}: {who}" for player, who in rows["seats"].items())
    rows["labels"] = ", ".join(f"{k}={v}" for k, v in rows["labels"].items()) or "-"
    rows["treated"] = _treated(rows["treated"])
    rows["rejected"] = _counts(rows["rejected"])
    rows["activities"] = _counts(rows["activities"])
    rows["staleness"] = _staleness(rows["staleness"])
    rows["outcome"] = f"{end['reason']} after {end['seconds']} s" if end else _no_end(file)
    for key, value in [*rows.items(), *course_text(recording)]:
        tell(printable(f"{key:10} {value}"))


def _treated(treatments: dict[str, dict[str, Any]]) -> str:
    """What a study did to seats; a dash for nothing."""
    told = [
        f"{player}: {', '.join(f'{name} {value}' for name, value in treatment.items())}"
        for player, treatment in treatments.items()
    ]
    return "; ".join(told) or "-"


def _counts(of_each: dict[str, dict[str, int]]) -> str:
    """What of each player was how often; a dash for nothing of anybody."""
    told = []
    for player, counts in of_each.items():
        if words := ", ".join(f"{number} {what}" for what, number in counts.items() if number):
            told.append(f"{player}: {words}")
    return "; ".join(told) or "-"


def _staleness(of_each: dict[str, float | None]) -> str:
    """How many steps old the picture was on which each player's actions were based."""
    told = [f"{p}: {steps:.1f} steps" for p, steps in of_each.items() if steps is not None]
    return ", ".join(told) or "-"


def _no_end(file: Path) -> str:
    """Why a recording has no outcome."""
    open_still = file.suffix == ".part"
    return "no end: it is being played, or was left" if open_still else "no end: it was cut off"


@replay.command()
@failing
def notes(file: FileArgument, damaged: DamagedOption = False) -> None:
    """List what happened between the steps: who came, went and returned, chat, pauses, rejections.

    Each line begins with the step it came after and the seconds since the game began.
    """
    for line in note_lines(_open(file, damaged=damaged)):
        tell(printable(line))


@replay.command()
@failing
def said(
    file: FileArgument,
    player: Annotated[
        str | None, typer.Option(help="Whose model; those of all if left out.")
    ] = None,
    json_output: Annotated[
        bool, typer.Option("--json", help="Print a line of JSON a call, with all that was sent.")
    ] = False,
    damaged: DamagedOption = False,
) -> None:
    """Show what language models were sent and what they said, call by call.

    Messages that were sent in the call before as well are only counted.
    """
    recording = _open(file, damaged=damaged)
    for text in call_texts(recording, player, as_json=json_output):
        tell(printable_json(text) if json_output else text)


@replay.command()
def verify(files: Annotated[list[Path], typer.Argument(help="Recordings.")]) -> None:
    """Re-simulate recordings and compare every fact, timer and hash.

    Exit status 1 if any differs, is damaged, or is closed without an end; says the first step and
    the first fact that differ, or the byte.
    """
    failed = False
    for file in files:
        try:
            result = read_recording(file).verify()
        except RobotouilleError as error:
            tell(explain(error), err=True)
            failed = True
            continue
        cut = "" if result.complete else f" ({_no_end(file)})"
        if result.ok:
            tell(f"{file}: verified, {result.steps} steps{cut}")
        else:
            failed = True
            reason = result.fault or "the frames differ when written anew"
            tell(f"{file}: does NOT verify: {reason}{cut}", err=True)
    if failed:
        raise typer.Exit(1)


@replay.command()
def steps(
    file: FileArgument,
    json_output: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    expansions: Annotated[
        int, typer.Option(min=1, help="Expansions that the search from one state may cost.")
    ] = 2_000,
    seconds: Annotated[
        float, typer.Option(min=0.1, help="Seconds after which nothing more is searched.")
    ] = 300.0,
) -> None:
    """Say how many steps the goal was away at each step, and how good the play was.

    A range where the search gave up: more expansions make it narrower. Exit status 1 if the file
    cannot be read.
    """
    recording, deadline = _open(file), Deadline(seconds)
    silent = json_output or not sys.stdout.isatty()
    rows: list[StepsLeft] = []
    try:
        found = distances(recording, expansions, deadline)
        found = _with_progress(found, recording.length, silent)
        for frame, row in zip((None, *recording.steps), found, strict=True):
            rows.append(row)
            if not json_output:
                tell(_step_text(recording, frame, row))
    except RobotouilleError as error:
        fail(explain(error))
    except KeyboardInterrupt:
        fail("interrupted", 130)
    if json_output:
        typer.echo(json.dumps(_steps_json(recording, rows)))
    else:
        tell("\n".join(_summary(recording, rows)))
    if deadline.struck:
        late = f"{seconds:g} seconds were over: of the rest only bounds are given (--seconds)"
        tell(late, err=True)


def _with_progress(
    found: Iterator[StepsLeft], length: int, show_progress: bool
) -> Iterator[StepsLeft]:
    """The same, with a line that says how far it is, once it has taken a while."""
    began, status = time.monotonic(), Console(stderr=True).status("")
    try:
        for step in range(length + 1):
            if show_progress and time.monotonic() - began > PATIENCE:
                status.update(f"step {step} of {length}")
                status.start()
            yield next(found)
    finally:
        status.stop()


def _rate(recording: Recording, rows: Sequence[StepsLeft]) -> Range | None:
    """Steps taken by the fewest possible; None without success, or where steps are not alike."""
    if rows[-1].steps != 0 or recording.task.timing is not Timing.BENCHMARK:
        return None
    taken = len(rows) - 1
    return quotient(StepsLeft(taken, taken), rows[0])


def _steps_json(recording: Recording, rows: Sequence[StepsLeft]) -> dict[str, Any]:
    rate, left = _rate(recording, rows), quotient(rows[-1], rows[0])
    return {
        "task": recording.task.name,
        "seats": recording.task.seats,
        "steps": [{"step": i, **asdict(row), "exact": row.exact} for i, row in enumerate(rows)],
        "success": rows[-1].steps == 0,
        "optimality_rate": rate and asdict(rate),
        "normalized_steps_to_go": left and asdict(left),
    }


def _step_text(recording: Recording, frame: dict[str, Any] | None, row: StepsLeft) -> str:
    """The line of the state after a step; with the heading, that of the state before the first."""
    if frame is None:
        return f" step  to go\n{0:5}  {_left(row):>5}"
    actions = "; ".join(map(str, recording.actions(frame))) or "-"
    return f"{frame['step']:5}  {_left(row):>5}  {actions}"


def _summary(recording: Recording, rows: Sequence[StepsLeft]) -> Iterator[str]:
    yield ""
    if recording.task.timing is not Timing.BENCHMARK:
        yield "Steps to go are counted without the longer delays of this recording's timing."
    yield f"steps taken             {len(rows) - 1}"
    yield f"fewest possible         {_left(rows[0])}"
    yield f"optimality rate         {_range(_rate(recording, rows))}"
    out_of_reach = "the goal is out of reach" if rows[-1].dead else ""
    yield f"normalized steps to go  {out_of_reach or _range(quotient(rows[-1], rows[0]))}"


def _left(row: StepsLeft) -> str:
    if row.dead:
        return "never"
    if row.exact:
        return str(row.steps)
    return f"{row.bound}-{'?' if row.steps is None else row.steps}"


def _range(found: Range | None) -> str:
    if found is None:
        return "-"
    if found.least == found.most:
        return f"{found.least:.2f}"
    return f"{found.least:.2f} to {'?' if found.most is None else f'{found.most:.2f}'}"


@replay.command()
def export(
    file: FileArgument,
    output: Annotated[
        Path | None, typer.Option(help="File to write; standard output else.")
    ] = None,
    texts: Annotated[bool, typer.Option(help="Add each seat's observation in words.")] = False,
    damaged: DamagedOption = False,
) -> None:
    """Write a recording as JSON lines: header, steps, outcome."""
    recording = _open(file, damaged=damaged)
    try:
        lines = "".join(f"{line}\n" for line in json_lines(recording, texts=texts))
        if output is None:
            sys.stdout.write(printable_json(lines))
        else:
            output.write_text(lines, encoding="utf-8")
    except (OSError, RobotouilleError) as error:
        fail(explain(error))


@replay.command()
def play(
    files: Annotated[
        list[Path], typer.Argument(help="A recording; two of the same task are shown side by side.")
    ],
    speed: Annotated[
        float | None,
        typer.Option(
            help="Steps a second; as recorded in real time, else 5, if left out.", min=0.1, max=60
        ),
    ] = None,
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "1280x720",
    at: Annotated[int, typer.Option(help="The step to begin at.", min=0)] = 0,
    screenshot: Annotated[
        Path | None, typer.Option(help="Only save a picture of that step; needs no screen.")
    ] = None,
    rendering: RenderingOption = "",
    lenient: LenientOption = False,
    tasks: TasksOption = None,
) -> None:
    """Watch a recording in a window, or two side by side: H shows the keys.

    Of a damaged or unfinished file what there is is shown.
    """
    from robotouille_client.window import require_pygame

    try:
        require_pygame()
        from robotouille_client.window.replay.viewer import watch

        recordings = [_open_shown(file, tasks) for file in files]
        for recording in recordings:
            check_look(recording.task, rendering, lenient)
        opened = list(zip(files, recordings, strict=True))
        watch(opened, speed, size, at=at, screenshot=screenshot, rendering=rendering)
    except RobotouilleError as error:
        fail(explain(error))


@replay.command()
def video(
    file: FileArgument,
    output: Annotated[Path, typer.Argument(help="A file to write: .mp4 or .gif.")],
    speed: Annotated[float, typer.Option(help="Steps a second.", min=0.1, max=60)] = 4.0,
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "1280x720",
    first: Annotated[
        int | None, typer.Option("--from", help="The first step; else the beginning.", min=0)
    ] = None,
    last: Annotated[
        int | None, typer.Option("--to", help="The last step; else the end.", min=0)
    ] = None,
    rendering: RenderingOption = "",
    lenient: LenientOption = False,
    tasks: TasksOption = None,
) -> None:
    """Write a recording, or a span of it, as a video."""
    from robotouille_client.window import require_pygame

    try:
        require_pygame()
        from robotouille_client.window.replay.film import film
        from robotouille_client.window.replay.history.recorded import RecordedHistory

        recording = _open_shown(file, tasks)
        check_look(recording.task, rendering, lenient)
        history = RecordedHistory(recording)
        with terminable():
            frames = film(history, output, speed, size, (first, last), rendering)
    except RobotouilleError as error:
        fail(explain(error))
    tell(f"{output}: {frames} frames")
