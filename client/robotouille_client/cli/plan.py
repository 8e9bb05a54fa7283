"""Commands `robotouille plan` and `robotouille pddl`: plan a task, or export it."""

from __future__ import annotations

import json
import math
import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
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
from robotouille.files.writing import check_file, check_folder, replace_file
from robotouille.planning import solvers as optimal
from robotouille.planning.pddl import EncodingStyle, encode
from robotouille.planning.plan import Limits, read_plan, write_plan
from robotouille.planning.plugins import domain_planner
from robotouille.planning.search.unsolvable import unreachable_goal
from robotouille.replay.recording import read_recording
from robotouille.terminal import one_of, options_from, printable_json, tell
from robotouille.world.lint import sound_task
from robotouille_client.cli.plain_search import searched_plainly
from robotouille_client.console import explain, fail

PATIENCE = 2.0
"""Seconds before progress is shown on a terminal."""
FIRST_LINE = 10.0
"""Seconds before the first line of progress without a terminal. Each next line takes twice as
long, so that logs of long searches stay short."""


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """Options of `robotouille plan`."""

    recording: Annotated[
        str | None,
        typer.Option("--from", help="RECORDING@STEP: plan from a state of a recorded game."),
    ] = None
    seats: Annotated[int | None, typer.Option(help="Number of seats.")] = None
    timing: Annotated[
        Timing | None,
        typer.Option(parser=one_of(Timing), help="Timing profile. Default: benchmark."),
    ] = None
    expansions: Annotated[int | None, typer.Option(min=0, help="Search budget in expansions.")] = (
        None
    )
    timeout: Annotated[float | None, typer.Option(min=0.1, help="Time limit in seconds.")] = None
    out: Annotated[Path | None, typer.Option(help="File for the plan.")] = None
    json_output: Annotated[bool, typer.Option("--json", help="Print a certificate.")] = False
    certificate: Annotated[
        bool,
        typer.Option("--certificate", help="Write a certificate next to the plan or problem file."),
    ] = False


@options_from(PlanOptions)
def plan(
    options: PlanOptions,
    task: Annotated[
        str | None, typer.Argument(help="Task name or problem file; @N for N seats.")
    ] = None,
) -> None:
    """Find the shortest plan of a task, and prove that no plan is shorter.

    Ctrl+C or a limit ends the search with the best plan so far, and its gap to the lower bound.
    The exit status is 1 if the command finds no plan.
    """
    try:
        found, start = _beginning(task, options)
        place = _checked_output(task, found, start, options)
        if found.problem.shift is not None:
            _plan_shift(found, start, options)
            return
        answer = _search(found, start, options.expansions, Deadline(options.timeout or math.inf))
        world = World(found) if start is None else start.world
        notes = [] if options.recording is None else [f"from: {options.recording}"]
        _publish(answer, _text(answer, world, notes), options.out, options.json_output)
        if place is not None:
            write_certificate(answer, place)
    except (RobotouilleError, ValidationError, KeyError) as error:
        fail(explain(error))
    except KeyboardInterrupt:
        fail("interrupted", 130)
    if answer.plan is None:
        fail(_failure(answer) + _impossible_parts(answer, world, start))


def _checked_output(
    name: str | None, task: Task, start: State | None, options: PlanOptions
) -> Path | None:
    """Check the output options before the search; return the certificate's path, if any."""
    out = options.out
    place = _certificate_path(name, task, out) if options.certificate else None
    if options.certificate and start is not None:
        raise RobotouilleError("--certificate needs the start of a task: leave out --from")
    if out is not None:
        check_file(out)
    return place


# Start


def _beginning(name: str | None, options: PlanOptions) -> tuple[Task, State | None]:
    seats, timing, recording = options.seats, options.timing, options.recording
    if recording is None:
        if name is None:
            raise RobotouilleError("expected a task, a problem file or --from RECORDING@STEP")
        return sound_task(load_task(name, seats=seats, timing=timing or Timing.BENCHMARK)), None
    if seats is not None or timing is not None:
        raise RobotouilleError("leave out --seats and --timing: the recording has its own")
    start = _recorded_state(recording)
    task = start.world.task
    if name is not None:
        # Plans are for the task as it was recorded, even if its file has changed since.
        given = load_task(name, seats=task.seats, timing=task.timing)
        if replace(given, name=task.name).digest != task.digest:
            raise RobotouilleError(
                f"{recording} has {task.name}@{task.seats} as it was recorded, which is not {name}"
            )
    return task, start


def _recorded_state(reference: str) -> State:
    file, _, number = reference.rpartition("@")
    if not file or not re.fullmatch("[0-9]{1,9}", number):
        raise RobotouilleError(f"expected RECORDING@STEP like game.rbt@12, found {reference!r}")
    recording, step = read_recording(Path(file)), int(number)
    last = recording.length
    if step > last:
        raise RecordingError(f"{file}: no step {step}; the steps are 0 to {last}")
    return next(islice(recording.states(), step, None))[1]


# Search


def _search(
    task: Task, start: State | None, expansions: int | None, deadline: Deadline
) -> Certificate:
    from robotouille.planning.solvers import check_has_goal

    world = World(task)
    check_has_goal(world)
    if _has_to_compile(world):
        answer = searched_plainly(task, start, expansions, deadline.seconds)
        if answer is not None:
            return answer
    progress = _Progress()
    limits = Limits(expansions, BUDGET.states, deadline)
    with _interruptible(deadline), progress.shown():
        return certify(task, optimal.solve, limits, progress, start)


def _has_to_compile(world: World) -> bool:
    """Return whether a search has to compile the planner, which delays the first one."""
    from robotouille.planning.kitchen.kernels import to_be_compiled
    from robotouille.planning.kitchen.plugin import KITCHEN

    return domain_planner(world) is KITCHEN and to_be_compiled()


@contextmanager
def _interruptible(deadline: Deadline) -> Iterator[None]:
    """Make the first Ctrl-C end the search, and a second one the program."""

    def strike(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        deadline.strike()

    before = signal.signal(signal.SIGINT, strike)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


class _Progress:
    """`Watch` that shows the progress of a long search on stderr."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._began = time.monotonic()
        self._next_line = FIRST_LINE
        self._status: Status | None = None

    def __call__(self, expansions: int, bound: int, length: int | None) -> None:
        best = "no plan yet" if length is None else f"plan {length}, gap {max(0, length - bound)}"
        words = f"{expansions:,} expansions, lower bound {bound}, {best}"
        self._show(f"{words} (Ctrl-C takes the best plan so far)")

    def _show(self, words: str) -> None:
        seconds = time.monotonic() - self._began
        if seconds < (PATIENCE if self._console.is_terminal else self._next_line):
            return
        words = f"{seconds:.0f} s, {words}"
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


class _ShiftProgress(_Progress):
    """Progress of the bots that play a shift."""

    def __init__(self, steps: int) -> None:
        super().__init__()
        self._steps = steps

    def show(self, state: State) -> None:
        if state.orders is not None:
            time, score = state.orders.time, state.orders.score
            self._show(f"step {time} of {self._steps}, {score} points")


# Results


def _text(certificate: Certificate, world: World, notes: list[str]) -> str:
    """Return the plan with comments about its proof, or an empty text without a plan."""
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
    bound = f"lower bound {certificate.bound} ({certificate.proof.value})"
    return f"{bound}, gap {certificate.gap}"


def _failure(certificate: Certificate) -> str:
    name = f"{certificate.task}@{certificate.seats}"
    if certificate.unsolvable:
        return f"{name} is unsolvable: no plan reaches the goal ({certificate.proof.value})"
    proven = f"lower bound {certificate.bound} ({certificate.proof.value})"
    return f"{name}: no plan found in {certificate.expansions:,} expansions; {proven}"


def _impossible_parts(certificate: Certificate, world: World, start: State | None) -> str:
    if not certificate.unsolvable:
        return ""
    parts = unreachable_goal(world, start, limits=Limits(expansions=20_000, states=100_000))
    return "".join(f"\n  impossible: {part}" for part in parts)


def _certificate_path(name: str | None, task: Task, out: Path | None) -> Path:
    if out is not None:
        return out.with_name(f"{out.stem}.certificate.json")
    if re.search(r"\.json(@[0-9]{1,3})?$", name or ""):
        return certificate_path(Path(task.source), task)
    raise RobotouilleError(
        "--certificate needs a problem file or --out FILE, next to which it is written"
    )


# Shifts


def _plan_shift(task: Task, start: State | None, options: PlanOptions) -> None:
    """Play a shift with planner bots, and publish their plan, score and upper bound."""
    from robotouille.planning.policies.shift_policy import play_shift

    for given, name in ((start is not None, "--from"), (options.certificate, "--certificate")):
        if given:
            raise RobotouilleError(f"{name} needs a goal, and {task.name} is a shift")
    world = World(task)
    if world.shift is None:
        raise AssertionError("a task with a shift has its rules")
    steps, bound, progress = world.shift.steps, world.shift.bound, _ShiftProgress(world.shift.steps)
    with progress.shown():
        plan, last = play_shift(world, watch=progress.show)
    orders = last.orders
    if orders is None:
        raise AssertionError("a shift has orders")
    results = {"score": orders.score, "bound": bound, "served": orders.served,
               "expired": orders.expired, "steps": steps}  # fmt: skip
    text = write_plan(plan, world, [f"{name}: {value}" for name, value in results.items()])
    if options.out is not None:
        write_whole(options.out, text)
    if options.json_output:
        typer.echo(json.dumps({"task": task.name, "seats": task.seats, **results}))
    elif options.out is not None:
        tell(f"{options.out}: {orders.score} points, upper bound {bound}")
    else:
        tell(text, nl=False)


# Export


def pddl(
    task: Annotated[str, typer.Argument(help="Task name or problem file.")],
    out: Annotated[Path, typer.Option(help="Folder for domain.pddl and problem.pddl.")],
    encoding: Annotated[
        EncodingStyle,
        typer.Option(help="steps: exact. durative: PDDL 2.1, an approximation."),
    ] = EncodingStyle.STEPS,
    seats: Annotated[int | None, typer.Option(help="Number of seats.")] = None,
    created: Annotated[
        int | None,
        typer.Option(min=1, help="Number of objects of each kind that actions can create."),
    ] = None,
) -> None:
    """Write a task in PDDL for other planners."""
    try:
        check_folder(out)
        written = encode(World(load_task(task, seats=seats)), encoding, created=created)
        out.mkdir(parents=True, exist_ok=True)
        replace_file(out / "domain.pddl", written.domain)
        replace_file(out / "problem.pddl", written.problem)
    except (RobotouilleError, ValidationError, KeyError, OSError) as error:
        fail(explain(error))
