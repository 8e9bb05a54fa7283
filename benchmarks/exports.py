"""Measure exporting a catalogue to files.

python -m benchmarks.exports --episodes 1000 --formats parquet,csv,jsonl

The rows are synthetic: 200 steps of two seats and fifteen events in each episode. Each result
includes the current speed of the machine, measured with 20 million additions. Needs the extra
`data`.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

EPISODES, STEPS, EVENTS, SEATS = 1_000, 200, 15, (0, 1)
WANTED, SECONDS = 2_000_000, 60.0
ADDITIONS, QUIET = 20_000_000, 1.25
"""Number of additions, and the seconds that they take on an idle machine."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=EPISODES)
    parser.add_argument("--formats", default="parquet")
    options = parser.parse_args(arguments)
    if not (find_spec("sqlalchemy") and find_spec("pyarrow")):
        print("exports: skipped; need the extra `data`")
        return
    with tempfile.TemporaryDirectory() as name:
        measure(Path(name), options.episodes, options.formats.split(","))


def measure(folder: Path, episodes: int, formats: Sequence[str]) -> None:
    """Make a catalogue and export it in each format."""
    from robotouille_data.database import database_url
    from robotouille_data.exports.exporting import export
    from robotouille_data.exports.request import ExportFormat, ExportRequest

    url = database_url(None, folder)
    fill(url, episodes)
    steps = episodes * STEPS
    for name in formats:
        slower = _additions() / QUIET
        began = time.perf_counter()
        export(url, folder / name, ExportRequest((ExportFormat(name),)))
        seconds = time.perf_counter() - began
        print(
            f"{name}: {steps:,} steps of two seats in {seconds:.1f} s; {WANTED:,} in "
            f"{seconds * WANTED / steps:.0f} s (target: {SECONDS:.0f} s); the machine took "
            f"{slower:.1f} times as long as when idle"
        )


def fill(url: Any, episodes: int) -> None:
    """Fill a catalogue with synthetic rows."""
    from robotouille_data import schema
    from robotouille_data.database import insert, migrate, writing_engine

    with writing_engine(url).begin() as connection:
        migrate(connection)
        for number in range(episodes):
            insert(connection, schema.EPISODES, [_episode(number)])
            insert(connection, schema.SEATS, [_seat(number, seat) for seat in SEATS])
            insert(connection, schema.STEPS, list(_steps(number)))
            insert(connection, schema.EVENTS, list(_events(number)))
            insert(connection, schema.LABELS, [(number, "condition", f"c{number % 2}")])
            insert(connection, schema.MEASURES, [_measures(number)])


def _episode(number: int) -> tuple[Any, ...]:
    task = ("multi_agent/01_lettuce_burger", "0" * 32, "people", 0)
    rules = ("realtime", 5.0, STEPS, "bot", 30.0, "free", "[]", len(SEATS))
    course = ("goal", "", STEPS, STEPS / 5, STEPS / 5, "ABCDE-FGHIJ", "")
    times = ("2026-01-01T00:00:00Z", "2026-01-01T00:00:05Z", "2026-01-01T00:01:00Z")
    return number, f"e{number}", "ended", *times, "0", *task, *rules, *course


def _seat(number: int, seat: int) -> tuple[Any, ...]:
    who = (f"robot{seat + 1}", f"name{number % 100}", "human", f"p{number % 100}")
    steps = (100, 60, 10, 10, 10, 10, 0, None, None)
    return number, seat, *who, *steps, 1, 2, 3, 6, 2, 30_000, 1.5, 0.5, "", 0


def _steps(number: int) -> Iterator[tuple[Any, ...]]:
    for step in range(1, STEPS + 1):
        for seat in SEATS:
            begin = (number, step, seat, step * 200, 0)
            if (number + step + seat) % 2:
                yield *begin, "busy", False, None, "human", None, None, None, None, None
            else:
                arguments = f"robot{seat + 1} table{step % 9} table{number % 9}"
                yield (
                    *begin,
                    "acted",
                    False,
                    None,
                    "human",
                    "move",
                    arguments,
                    True,
                    7 * step % 997,
                    0,
                )


def _events(number: int) -> Iterator[tuple[Any, ...]]:
    for place in range(EVENTS):
        when = (place * 10, place * 2_000)
        yield number, place, *when, "said", 0, f"name{number % 100}", "one moment", "{}"


def _measures(number: int) -> tuple[Any, ...]:
    return number, True, 40, STEPS / 40, 3, 4, 0, 0, False


def _additions() -> float:
    began, total = time.perf_counter(), 0
    for _ in range(ADDITIONS):
        total += 1  # noqa: SIM113
    return time.perf_counter() - began


if __name__ == "__main__":
    main()
