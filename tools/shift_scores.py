"""Write the points of planner bots into the shipped shifts: `planner` or `planner_people`.

    python tools/shift_scores.py [--timing people] [TASK...]

Run it after a change to a shift, or to the planner. It takes some minutes, and for the timing of
people half an hour. A better planner need not renew those points: the window shows them as the
best known ones.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from robotouille import Timing, World, load_task, task_names
from robotouille.planning.policies.shift_policy import play_shift

FIELDS = {Timing.BENCHMARK: "planner", Timing.PEOPLE: "planner_people"}


def planner_points(name: str, seats: int, timing: Timing) -> int:
    """Return the points of planner bots in a number of seats."""
    _, last = play_shift(World(load_task(name, seats=seats, timing=timing)))
    if last.orders is None:
        raise AssertionError("a shift has orders")
    return last.orders.score


def write(path: Path, field: str, points: Mapping[int, int]) -> None:
    """Replace the points in a problem file."""
    rows = ", ".join(f'"{seats}": {each}' for seats, each in points.items())
    pattern = rf'"{field}": \{{[^}}]*\}}'
    text, count = re.subn(pattern, f'"{field}": {{{rows}}}', path.read_text(encoding="utf-8"))
    if count != 1:
        raise SystemExit(f"{path}: expected one field `{field}`")
    path.write_text(text, encoding="utf-8")
    print(f"{path.stem}: {field}: {rows}")


def main(chosen: Iterable[str], timing: Timing) -> None:
    """Write the points of the chosen shifts, by default of all."""
    names = list(chosen) or [name for name in task_names() if name.startswith("shifts/")]
    with ProcessPoolExecutor() as pool:
        for task in map(load_task, names):
            seats = task.problem.seats or (task.seats,)
            points = pool.map(partial(planner_points, task.name, timing=timing), seats)
            write(Path(task.source), FIELDS[timing], dict(zip(seats, points, strict=True)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="*")
    parser.add_argument("--timing", type=Timing, default=Timing.BENCHMARK)
    options = parser.parse_args()
    main(options.tasks, options.timing)
