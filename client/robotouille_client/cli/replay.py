"""Commands `robotouille replay …`: show, verify, measure, watch and export recordings."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from robotouille.certification.certificate import Deadline
from robotouille.errors import RobotouilleError
from robotouille.files.writing import check_file, replace_file, whole_file
from robotouille.planning.steps_to_go import StepsLeft
from robotouille.replay.annotations import agreement, read_annotations, read_codebook
from robotouille.replay.annotations import rows as agreement_rows
from robotouille.replay.controllers import json_lines
from robotouille.replay.distances import distances
from robotouille.replay.model_calls import call_texts
from robotouille.replay.recording import Recording, read_recording
from robotouille.replay.timeline import course, course_text, note_lines
from robotouille.terminal import options_from, printable, printable_json, tell
from robotouille_client.cli.recording_info import info_rows, info_texts, no_outcome
from robotouille_client.cli.steps_to_go import (
    all_steps_to_go,
    step_text,
    steps_json,
    summary,
    with_progress,
)
from robotouille_client.console import (
    JsonOption,
    LenientOption,
    RenderingOption,
    check_look,
    explain,
    fail,
    failing,
    folder,
    terminable,
)

replay = typer.Typer(
    no_args_is_help=True, help="Show, verify, measure, watch and export recordings."
)

FileArgument = Annotated[
    Path, typer.Argument(help="Recording (.rbt, or .rbt.part while it is being written).")
]
DamagedOption = Annotated[
    bool, typer.Option("--damaged", help="Read a damaged file up to the damage.")
]


@dataclass(frozen=True, kw_only=True)
class LookOptions:
    """Options of commands that show recordings in pictures."""

    rendering: RenderingOption = ""
    lenient: LenientOption = False
    tasks: Annotated[
        Path | None,
        typer.Option(
            callback=folder,
            help="Folder of the task's files, with its pictures. Default: the current folder.",
        ),
    ] = None

    def open(self, file: Path) -> Recording:
        """Open a recording, damaged or not, and check its pictures."""
        from robotouille_client.window.replay.histories.recorded_history import open_shown

        tasks = self.tasks
        recording = open_shown(file, tasks, damaged=True)
        if tasks is not None and recording.task.folder != tasks:
            name = recording.task.domain.name
            tell(f"--tasks {tasks}: no rendering of the domain {name!r}", err=True)
        _report_damage(file, recording)
        check_look(recording.task, self.rendering, self.lenient)
        return recording


def _open(file: Path, *, damaged: bool = False) -> Recording:
    recording, why = None, ""
    try:
        recording = read_recording(file, damaged=damaged)
    except RobotouilleError as error:
        why = explain(error)
    # After the block, the error no longer keeps in memory what was read.
    if recording is None:
        # Of some damaged files nothing can be read, not even with the option.
        hint = "" if damaged or not _is_readable(file) else "; --damaged reads what is before it"
        fail(f"{why}{hint}")
    _report_damage(file, recording)
    return recording


def _is_readable(file: Path) -> bool:
    """Return whether a damaged file can be read up to the damage."""
    try:
        return bool(read_recording(file, damaged=True).damage)
    except RobotouilleError:
        return False


def _report_damage(file: Path, recording: Recording) -> None:
    if recording.damage:
        kept = f"only the {recording.length} steps before the damage were read"
        tell(printable(f"{file}: {recording.damage}; {kept}"), err=True)


@dataclass(frozen=True, kw_only=True)
class DrawingOptions(LookOptions):
    """Options of commands that draw recordings."""

    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "1280x720"


@replay.command()
@failing
def info(
    file: FileArgument,
    json_output: JsonOption = False,
    damaged: DamagedOption = False,
) -> None:
    """Show the task, the participants and their steps, pauses, and the outcome."""
    recording = _open(file, damaged=damaged)
    rows = info_rows(recording)
    if json_output:
        head = recording.header
        names = {key: head.get(key, "") for key in ("episode", "code", "owner")}
        typer.echo(json.dumps({**rows, **names, **course(recording)}))
        return
    for key, value in [*info_texts(file, rows).items(), *course_text(recording)]:
        tell(printable(f"{key:10} {value}"))


@replay.command()
@failing
def notes(file: FileArgument, damaged: DamagedOption = False) -> None:
    """List the events between steps: arrivals, absences, returns, chat, pauses, rejections.

    Each line begins with the step before the event and the seconds since the game began.
    """
    for line in note_lines(_open(file, damaged=damaged)):
        tell(printable(line))


@replay.command()
@failing
def said(
    file: FileArgument,
    player: Annotated[
        str | None, typer.Option(help="Player of the language model. Default: all.")
    ] = None,
    json_output: Annotated[
        bool,
        typer.Option("--json", help="Print one line of JSON for each call, with all messages."),
    ] = False,
    damaged: DamagedOption = False,
) -> None:
    """Show the transcript of the language models, call by call.

    Messages repeated from the previous call are counted, not shown.
    """
    recording = _open(file, damaged=damaged)
    for text in call_texts(recording, player, as_json=json_output):
        tell(printable_json(text) if json_output else text)


@replay.command()
def verify(files: Annotated[list[Path], typer.Argument(help="Recordings.")]) -> None:
    """Simulate recordings again and compare every fact, timer and hash.

    The exit status is 1 if a recording differs, is damaged, or was closed without an outcome. The
    error names the first different step and fact, or the damaged byte.
    """
    failed = False
    for file in files:
        why = ""
        try:
            result = read_recording(file).verify()
        except RobotouilleError as error:
            why = explain(error)
        if why:
            near = f"; `robotouille replay info {file} --damaged` shows what is before it"
            tell(printable(f"{why}{near if _is_readable(file) else ''}"), err=True)
            failed = True
            continue
        cut = "" if result.complete else f" ({no_outcome(file)})"
        if result.ok:
            tell(printable(f"{file}: verified, {result.steps} steps{cut}"))
        else:
            failed = True
            reason = result.fault or "the frames differ when they are written again"
            # A recorded text could contain a line feed, and a line that looks like a result.
            tell(printable(f"{file}: does NOT verify: {reason}{cut}"), err=True)
    if failed:
        raise typer.Exit(1)


@replay.command()
def steps(
    file: FileArgument,
    json_output: JsonOption = False,
    expansions: Annotated[
        int, typer.Option(min=1, help="Search budget for each state, in expansions.")
    ] = 2_000,
    seconds: Annotated[
        float, typer.Option(min=0.1, help="Time limit in seconds for all searches.")
    ] = 300.0,
) -> None:
    """Show the steps to go at each step, and the optimality rate.

    A range means that the search gave up; more expansions make it narrower. The exit status is 1
    if the file cannot be read.
    """
    recording, deadline = _open(file), Deadline(seconds)
    rows: list[StepsLeft] = []
    try:
        found = distances(recording, expansions, deadline)
        printed = not json_output and sys.stdout.isatty()
        found = with_progress(found, recording.length, printed=printed)
        frames = chain((None,), recording.each_step())
        for frame, row in zip(frames, found, strict=True):
            rows.append(row)
            if not json_output:
                tell(step_text(recording, frame, row))
    except RobotouilleError as error:
        fail(explain(error))
    except KeyboardInterrupt:
        fail("interrupted", 130)
    if json_output:
        typer.echo(json.dumps(steps_json(recording, rows)))
    else:
        tell("\n".join(summary(recording, rows)))
    if deadline.struck:
        tell(f"stopped after {seconds:g} s: later steps show bounds only (see --seconds)", err=True)


@replay.command()
def export(
    file: FileArgument,
    out: Annotated[
        Path | None, typer.Option(help="File to write. Default: standard output.")
    ] = None,
    texts: Annotated[bool, typer.Option(help="Add the observation of each seat in words.")] = False,
    damaged: DamagedOption = False,
) -> None:
    """Write a recording as JSON lines: header, steps, outcome."""
    try:
        if out is not None:
            check_file(out)
        lines = json_lines(_open(file, damaged=damaged), texts=texts)
        if out is None:
            for line in lines:
                sys.stdout.write(f"{printable_json(line)}\n")
            return
        with whole_file(out) as file_out:
            file_out.writelines(f"{line}\n" for line in lines)
    except (OSError, RobotouilleError) as error:
        fail(explain(error))


@replay.command()
@options_from(DrawingOptions)
def play(
    files: Annotated[
        list[Path], typer.Argument(help="Recording, or two of the same task side by side.")
    ],
    options: DrawingOptions,
    speed: Annotated[
        float | None,
        typer.Option(
            help="Steps per second. Default: as recorded in real time, else 5.", min=0.1, max=60
        ),
    ] = None,
    at: Annotated[int, typer.Option(help="First step to show.", min=0)] = 0,
    screenshot: Annotated[
        Path | None, typer.Option(help="Only save a picture of that step; needs no screen.")
    ] = None,
) -> None:
    """Watch a recording in a window, or two side by side. H shows the keys.

    A damaged or unfinished file is shown up to its last valid step.
    """
    from robotouille_client.window import require_pygame

    try:
        require_pygame()
        from robotouille_client.window.replay.viewer import watch

        if screenshot is not None:
            check_file(screenshot, "--screenshot")
        opened = [(file, options.open(file)) for file in files]
        watch(
            opened,
            speed,
            options.size,
            at=at,
            screenshot=screenshot,
            rendering=options.rendering,
        )
    except RobotouilleError as error:
        fail(explain(error))


@replay.command()
@options_from(DrawingOptions)
def video(
    file: FileArgument,
    output: Annotated[Path, typer.Argument(help="File to write: .mp4 or .gif.")],
    options: DrawingOptions,
    speed: Annotated[float, typer.Option(help="Steps per second.", min=0.1, max=60)] = 4.0,
    first: Annotated[
        int | None, typer.Option("--from", help="First step. Default: the beginning.", min=0)
    ] = None,
    last: Annotated[
        int | None, typer.Option("--to", help="Last step. Default: the end.", min=0)
    ] = None,
) -> None:
    """Write a recording, or a span of it, as a video."""
    from robotouille_client.window import require_pygame

    try:
        require_pygame()
        from robotouille_client.window.replay.film import film
        from robotouille_client.window.replay.histories.recorded_history import RecordedHistory

        check_file(output, "OUTPUT")
        history = RecordedHistory(options.open(file))
        with terminable():
            frames = film(history, output, speed, options.size, (first, last), options.rendering)
    except RobotouilleError as error:
        fail(explain(error))
    tell(f"{output}: {frames} frames")


@replay.command()
@options_from(LookOptions)
def page(
    files: Annotated[
        list[Path], typer.Argument(help="Recording, or two of the same task side by side.")
    ],
    output: Annotated[Path, typer.Argument(help="File to write: .html.")],
    options: LookOptions,
    anonymous: Annotated[
        bool,
        typer.Option(
            "--anonymous",
            help="Replace names with p1, p2, … and leave out all texts of participants.",
        ),
    ] = False,
    steps_to_go: Annotated[bool, typer.Option(help="Add the steps to go, where found.")] = True,
    seconds: Annotated[
        float, typer.Option(min=0.1, help="Time limit in seconds for the steps to go.")
    ] = 30.0,
    codebook: Annotated[
        Path | None,
        typer.Option(
            help="Labels for steps, as JSON: a list `labels` of objects with `id`, `title` and "
            "`key`."
        ),
    ] = None,
) -> None:
    """Write recordings as one HTML file that browsers show without a server or a network.

    A damaged or unfinished file is shown up to its last valid step. Names of your own tasks and
    texts in their files are shown as they are.
    """
    if output.suffix.lower() not in (".html", ".htm"):
        shown = printable(str(output))
        fail(f"{shown}: the last argument is the page to write; its name must end with .html")
    from robotouille.web.recording_page import labels, replay_page

    try:
        check_file(output, "OUTPUT")
        codes = None if codebook is None else read_codebook(codebook)
        recordings = [options.open(file) for file in files]
        left, struck = all_steps_to_go(recordings, seconds) if steps_to_go else ([], False)
        text = replay_page(
            list(zip(labels([file.stem for file in files]), recordings, strict=True)),
            rendering=options.rendering,
            anonymous=anonymous,
            to_go=left if any(left) else (),
            codebook=codes,
        )
        replace_file(output, text)
    except (OSError, RobotouilleError) as error:
        fail(explain(error))
    except KeyboardInterrupt:
        fail("interrupted", 130)
    if struck:
        tell(f"stopped after {seconds:g} s: some steps to go are missing (--seconds)", err=True)
    tell(f"{output}: {len(text.encode()):,} bytes")


@replay.command("agreement")
@failing
def agreement_command(
    files: Annotated[list[Path], typer.Argument(help="Labels that pages have saved.")],
    json_output: JsonOption = False,
) -> None:
    """Show the agreement of coders about each label: Cohen's kappa and Krippendorff's alpha.

    Both compare, for each step, whether a label covers it. Kappa needs exactly two coders.
    """
    found = list(agreement([read_annotations(file) for file in files]))
    if json_output:
        typer.echo(json.dumps([asdict(each) for each in found]))
        return
    table = list(agreement_rows(found))
    widths = {key: max(len(key), *(len(row[key]) for row in table)) for key in table[0]}
    for row in ({key: key for key in widths}, *table):
        cells = (row[key].rjust(width) for key, width in widths.items() if key != "label")
        tell(printable(f"{row['label'].ljust(widths['label'])}  {'  '.join(cells)}"))
