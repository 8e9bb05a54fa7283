"""Steps to go of recordings: search with progress, texts and JSON."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from typing import Any

from rich.console import Console

from robotouille.certification.certificate import Deadline
from robotouille.certification.step_limit import retimed_length
from robotouille.domain.loading import shipped_task
from robotouille.domain.task import Timing
from robotouille.planning.steps_to_go import Range, StepsLeft, quotient
from robotouille.replay.recording import Recording

PATIENCE = 2.0
"""Seconds before progress is shown."""


@contextmanager
def _late_status() -> Iterator[Callable[[str], None]]:
    """Yield a function that sets the progress, which stderr shows after a while."""
    status = Console(stderr=True).status("")
    # A single search, or compiling the planner, can take minutes, so another thread begins.
    timer = threading.Timer(PATIENCE, status.start)
    timer.daemon = True
    timer.start()
    try:
        yield status.update
    finally:
        timer.cancel()
        timer.join()
        status.stop()


def with_progress(found: Iterator[StepsLeft], length: int, *, printed: bool) -> Iterator[StepsLeft]:
    """Yield the results for steps 0 to `length`, and show progress after a while.

    Args:
        printed: True if each result is printed. Progress is then shown only in between.
    """
    with nullcontext() if printed else _late_status() as whole:
        for step in range(length + 1):
            with _late_status() if whole is None else nullcontext(whole) as show:
                show(f"step {step} of {length}")
                row = next(found)
            yield row


def all_steps_to_go(
    recordings: Sequence[Recording], seconds: float
) -> tuple[list[Sequence[list[Any] | None]], bool]:
    """Return the steps to go of each recording, and whether the time ran out."""
    found, struck = [], False
    for recording in recordings:
        deadline = Deadline(seconds / len(recordings))
        found.append(_steps_to_go(recording, deadline))
        struck = struck or deadline.struck
    return found, struck


def _steps_to_go(recording: Recording, deadline: Deadline) -> Sequence[list[Any] | None]:
    """Return what can be found out about the steps to go, and show progress after a while.

    A shift has no goal, so it has no steps to go.
    """
    from robotouille.web.recording_page import steps_to_go

    if recording.task.problem.shift is not None:
        return []
    rows: list[list[Any] | None] = []
    with _late_status() as show:
        for rows in steps_to_go(recording, recording.length, deadline):
            known = sum(row is not None for row in rows)
            show(f"steps to go: {known} of {len(rows)} steps")
    return rows


def _rate(recording: Recording, rows: Sequence[StepsLeft]) -> Range | None:
    """Return the optimality rate, or None without success or with timing `people`."""
    if rows[-1].steps != 0 or recording.task.timing is not Timing.BENCHMARK:
        return None
    taken = len(rows) - 1
    return quotient(StepsLeft(taken, taken), rows[0])


def steps_json(recording: Recording, rows: Sequence[StepsLeft]) -> dict[str, Any]:
    """Return the steps to go and the rates as JSON values."""
    rate, left = _rate(recording, rows), quotient(rows[-1], rows[0])
    return {
        "task": recording.task.name,
        "seats": recording.task.seats,
        "steps": [{"step": i, **asdict(row), "exact": row.exact} for i, row in enumerate(rows)],
        "success": rows[-1].steps == 0,
        "optimality_rate": rate and asdict(rate),
        "normalized_steps_to_go": left and asdict(left),
    }


def step_text(recording: Recording, frame: dict[str, Any] | None, row: StepsLeft) -> str:
    """Return the line of a step; without a frame, the head and the line of the beginning."""
    if frame is None:
        return f" step  to go\n{0:5}  {_left(row):>5}"
    actions = "; ".join(map(str, recording.actions(frame))) or "-"
    return f"{frame['step']:5}  {_left(row):>5}  {actions}"


def summary(recording: Recording, rows: Sequence[StepsLeft]) -> Iterator[str]:
    """Yield the lines below the steps."""
    yield ""
    timing = recording.task.timing
    played = timing is Timing.BENCHMARK
    ideal = "" if played else " in the timing benchmark, as all steps to go: its delays are shorter"
    yield f"steps taken             {len(rows) - 1}"
    yield f"fewest possible         {_left(rows[0])}{ideal}"
    shipped = None if played else shipped_task(recording.task)
    known = None if shipped is None else retimed_length(shipped)
    if known is not None:
        yield f"best known              {known} in the timing {timing}, as played"
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
