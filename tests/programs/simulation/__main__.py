"""`python -m tests.programs.simulation`: run seeds, reproduce one, or simulate a long day."""

from __future__ import annotations

import argparse
import os
import sys

from tests.programs.simulation.day import simulate_day
from tests.programs.simulation.runs import run_many
from tests.programs.simulation.simulation import Report, run_seed


def main() -> int:
    options = _options()
    if options.day:
        hours, rooms = options.simulated_hours, options.rooms
        return _show(
            simulate_day(
                options.seed or 0, hours, lambda line: print(line, flush=True), rooms=rooms
            )
        )
    if options.seed is not None:
        return _show(run_seed(options.seed, trace=options.trace))
    return _run_many(options)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.programs.simulation", description=__doc__
    )
    parser.add_argument("--seeds", default="0:1000", metavar="FROM:TO", help="seeds to run")
    parser.add_argument("--seed", type=int, help="one seed")
    parser.add_argument("--trace", action="store_true", help="with --seed: print every event")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument(
        "--hours", type=float, help="run further seeds for this many hours (nightly)"
    )
    parser.add_argument(
        "--day", action="store_true", help="one long-lived server instead of many short runs"
    )
    parser.add_argument(
        "--simulated-hours", type=float, default=24.0, help="with --day: length of the day"
    )
    parser.add_argument("--rooms", type=int, default=4, help="with --day: simultaneous episodes")
    return parser.parse_args()


def _show(report: Report) -> int:
    print(
        f"seed {report.seed}: {'ok' if report.ok else 'FAILED'}, {report.seconds:.1f} s simulated, "
        f"{report.callbacks} callbacks, digest {report.digest}"
    )
    for what, times in sorted(report.counts.items()):
        print(f"    {what}: {times}")
    for fault in report.faults:
        print(f"    {fault}")
    return 0 if report.ok else 1


def _run_many(options: argparse.Namespace) -> int:
    first, _, last = options.seeds.partition(":")
    if options.hours is not None:
        return run_many(int(first), None, options.jobs, options.hours * 3600).finish()
    return run_many(int(first), int(last), options.jobs, None).finish()


if __name__ == "__main__":
    sys.exit(main())
