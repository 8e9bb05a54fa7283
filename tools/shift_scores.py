"""Write the points of planner bots into the shipped shifts: the field `planner` of `shift`.

    python tools/shift_scores.py [TASK...]

Run it after a change to a shift, or to the planner. It takes some minutes.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from robotouille import World, load_task, task_names
from robotouille.planning.policies.shift_policy import play_shift

FIELD = re.compile(r'"planner": \{[^}]*\}')


def planner_points(name: str, seats: int) -> int:
    """Return the points of planner bots in a number of seats."""
    _, last = play_shift(World(load_task(name, seats=seats)))
    if last.orders is None:
        raise AssertionError("a shift has orders")
    return last.orders.score


def main(chosen: Iterable[str]) -> None:
    """Write the points of the chosen shifts, by default of all."""
    names = list(chosen) or [name for name in task_names() if name.startswith("shifts/")]
    with ProcessPoolExecutor() as pool:
        for task in map(load_task, names):
            seats = task.problem.seats or (task.seats,)
            points = pool.map(planner_points, [task.name] * len(seats), seats)
            rows = ", ".join(f'"{n}": {each}' for n, each in zip(seats, points, strict=True))
            path = Path(task.source)
            text, count = FIELD.subn(f'"planner": {{{rows}}}', path.read_text(encoding="utf-8"))
            if count != 1:
                raise SystemExit(f"{path}: expected one field `planner`")
            path.write_text(text, encoding="utf-8")
            print(f"{task.name}: {rows}")


if __name__ == "__main__":
    main(sys.argv[1:])
