"""`robotouille plan TASK`: the shortest plan, and what is proven about it."""

from __future__ import annotations

import math
import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer
from pydantic import ValidationError
from rich.console import Console
from rich.status import Status

from robotouille import State, Task, Timing, World, load_task
from robotouille.certification.certificate import (
    Certificate,
    Deadline,
    certificate_path,
    certify,
    json_text,
    write_certificate,
    write_whole,
)
from robotouille.certification.certifying import BUDGET
from robotouille.errors import FileError, RecordingError, RobotouilleError
from robotouille.planning import solvers as optimal
from robotouille.planning.plan import read_plan, write_plan
from robotouille.planning.plugins import domain_planner
from robotouille.planning.search.unsolvable import unreachable_goal
from robotouille.planning.search_result import Limits
from robotouille.program import printable_json, tell
from robotouille.replay.recording import read_recording
from robotouille.world.lint import sound_task
from robotouille_client.console import explain, fail

__all__ = ["plan"]

PATIENCE = 2.0
"""Seconds before progress is shown."""
FIRST_LINE = 10.0
"""Seconds before progress is told in a line, where there is no terminal; the next lines come after
twice as long each."""


def plan(
    task: Annotated[
        str | None, typer.Argument(help="Task name or problem file; @N for N seats.")
    ] = None,
    recording: Annotated[
        str | None,
        typer.Option("--from", help="RECORDING@STEP: plan from where a recorded game stood."),
    ] = None,
    seats: Annotated[int | None, typer.Option(help="Number of seats.")] = None,
    timing: Annotated[Timing | None, typer.Option(help="Timing; benchmark by default.")] = None,
    expansions: Annotated[
        int | None, typer.Option(min=0, help="Give up after so many expansions.")
    ] = None,
    timeout: Annotated[
        float | None, typer.Option(min=0.1, help="Give up after so many seconds.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="File for the plan.")] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print a certificate.")] = False,
    certificate: Annotated[
        bool,
        typer.Option("--certificate", help="Write a certificate beside the plan or problem file."),
    ] = False,
) -> None:
    """Find the shortest plan of a task, and prove that it is.

    Ctrl-C or a limit ends the search with the best plan so far, and the gap to what is proven.
    Exit status 1 if there is no plan, or none was found.
    """
    try:
        found, start = _beginning(task, recording, seats, timing)
        place = _certificate_place(task, found, out) if certificate else None
        if certificate and start is not None:
            raise RobotouilleError("--certificate is for the start of a task: leave out --from")
        if out is not None and (not out.name or _is_folder(out)):
            raise RobotouilleError(f"--out: {str(out)!r} is a folder; expected a file")
        if out is not None and not out.parent.is_dir():
            raise RobotouilleError(f"there is no folder {out.parent}")
        answer = _search(found, start, expansions, Deadline(timeout or math.inf))
        notes = [] if recording is None else [f"from: {recording}"]
        text = _text(answer, World(found) if start is None else start.world, notes)
        _publish(answer, text, out, json_output)
        if place is not None:
            write_certificate(answer, place)
    except (RobotouilleError, ValidationError, KeyError) as error:
        fail(explain(error))
    except KeyboardInterrupt:
        fail("interrupted", 130)
    if answer.plan is None:
        fail(_despair(answer) + _why(answer, World(found) if start is None else start.world, start))


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except OSError:
        return False


# Where the plan begins


def _beginning(
    name: str | None, recording: str | None, seats: int | None, timing: Timing | None
) -> tuple[Task, State | None]:
    if recording is None:
        if name is None:
            raise RobotouilleError("expected a task, a problem file or --from RECORDING@STEP")
        return sound_task(load_task(name, seats=seats, timing=timing or Timing.BENCHMARK)), None
    if seats is not None or timing is not None:
        raise RobotouilleError("a recording has its own seats and timing: leave out yours")
    start = _recorded_state(recording)
    task = start.world.task
    if name is not None:
        given = load_task(name, seats=task.seats, timing=task.timing)
        if replace(given, name=task.name).digest != task.digest:
            raise RobotouilleError(
                f"{recording}: is of {task.name}@{task.seats} as it was recorded, not of {name}"
            )
    return task, start


def _recorded_state(reference: str) -> State:
    """The state of a recorded game after a step, for RECORDING@STEP."""
    file, _, number = reference.rpartition("@")
    if not file or not re.fullmatch("[0-9]{1,9}", number):
        raise RobotouilleError(f"expected RECORDING@STEP like game.rbt@12, found {reference!r}")
    recording, step = read_recording(Path(file)), int(number)
    last = recording.length
    if step > last:
        raise RecordingError(f"{file}: there is no step {step}; it has the steps 0 to {last}")
    return next(islice(recording.states(), step, None))[1]


# The search


def _search(
    task: Task, start: State | None, expansions: int | None, deadline: Deadline
) -> Certificate:
    _tell_of_compiling(World(task))
    progress = _Progress()
    limits = Limits(expansions, BUDGET.states, deadline)
    with _interruptible(deadline), progress.shown():
        return certify(task, optimal.solve, limits, progress, start)


def _tell_of_compiling(world: World) -> None:
    """Say why the first search of a kitchen takes so long, where its planner is compiled."""
    from robotouille.planners.kitchen.kernels import to_be_compiled
    from robotouille.planners.kitchen.plugin import KITCHEN

    if domain_planner(world) is KITCHEN and to_be_compiled():
        words = "compiling the planner, once for this machine: half a minute or a whole one"
        tell(f"{words} (ROBOTOUILLE_COMPILE=0 does without)", err=True)


@contextmanager
def _interruptible(deadline: Deadline) -> Iterator[None]:
    """The first Ctrl-C ends the search, a second one the program."""

    def strike(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        deadline.strike()

    before = signal.signal(signal.SIGINT, strike)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


class _Progress:
    """A `Watch` that shows a long search on stderr: on a terminal always, else in a few lines."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._began = time.monotonic()
        self._next_line = FIRST_LINE
        self._status: Status | None = None

    def __call__(self, expansions: int, bound: int, length: int | None) -> None:
        seconds = time.monotonic() - self._began
        if seconds < (PATIENCE if self._console.is_terminal else self._next_line):
            return
        best = "no plan yet" if length is None else f"plan {length}, gap {max(0, length - bound)}"
        words = f"{seconds:.0f} s, {expansions:,} expansions, bound {bound}, {best}"
        words += " (Ctrl-C takes what there is)"
        if not self._console.is_terminal:
            tell(words, err=True)
            self._next_line *= 2
            return
        if self._status is None:
            self._status = self._console.status(words)
            self._status.start()
        self._status.update(words)

    @contextmanager
    def shown(self) -> Iterator[None]:
        try:
            yield
        finally:
            if self._status is not None:
                self._status.stop()


# What is said


def _text(certificate: Certificate, world: World, notes: list[str]) -> str:
    """The plan with what is known about it as comments; empty without a plan."""
    if certificate.plan is None:
        return ""
    notes += [
        f"length: {certificate.length}",
        f"bound: {certificate.bound}",
        f"gap: {certificate.gap}",
        f"proof: {certificate.proof.value}",
        f"planner: {certificate.planner}, {certificate.expansions} expansions",
    ]
    return write_plan(read_plan("\n".join(certificate.plan), world), world, notes)


def _publish(certificate: Certificate, text: str, out: Path | None, json_output: bool) -> None:
    if json_output:
        typer.echo(printable_json(json_text(certificate)), nl=False)
    if not text:
        return
    if out is None:
        tell("" if json_output else text, nl=False)
        return
    try:
        write_whole(out, text)
    except FileError:
        tell(text, nl=False)
        raise
    if not json_output:
        tell(f"{out}: {certificate.length} steps, {_claim(certificate)}")


def _claim(certificate: Certificate) -> str:
    if certificate.optimal:
        return f"optimal ({certificate.proof.value})"
    return f"bound {certificate.bound} ({certificate.proof.value}), gap {certificate.gap}"


def _despair(certificate: Certificate) -> str:
    name = f"{certificate.task}@{certificate.seats}"
    if certificate.unsolvable:
        return f"{name} is unsolvable: no plan reaches the goal ({certificate.proof.value})"
    proven = f"bound {certificate.bound} ({certificate.proof.value})"
    return f"{name}: no plan was found in {certificate.expansions:,} expansions; {proven}"


def _why(certificate: Certificate, world: World, start: State | None) -> str:
    """The parts of the goal that cannot come true, where they are known."""
    if not certificate.unsolvable:
        return ""
    parts = unreachable_goal(world, start, limits=Limits(expansions=20_000, states=100_000))
    return "".join(f"\n  this can never be so: {part}" for part in parts)


def _certificate_place(name: str | None, task: Task, out: Path | None) -> Path:
    if out is not None:
        return out.with_name(f"{out.stem}.certificate.json")
    if re.search(r"\.json(@[0-9]{1,3})?$", name or ""):
        return certificate_path(Path(task.source), task)
    raise RobotouilleError("--certificate needs a problem file or --out FILE to lie beside")
