"""`python -m tests.programs.cluster_drill DRILL`: let nodes and NATS fail while bots play."""

from __future__ import annotations

import argparse
import asyncio
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from tests.programs.cluster_drill.drills import DRILLS, THROUGHPUT, run, run_short
from tests.programs.cluster_drill.stage import Result
from tests.programs.drill.report import aligned
from tests.support.nats import missing


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.programs.cluster_drill")
    names = [*DRILLS, THROUGHPUT]
    parser.add_argument("drill", nargs="+", choices=[*names, "all"], help="which drills to run")
    parser.add_argument("--games", type=int, help="simultaneous episodes")
    parser.add_argument("--nodes", type=int, default=3, help="nodes of the cluster")
    parser.add_argument("--rounds", type=int, help="rolling restarts")
    parser.add_argument("--processes", type=int, default=2, help="processes for the bots")
    parser.add_argument("--rate", type=float, help="steps per second of the episodes")
    parser.add_argument("--steps", type=_bounds, help="bounds of the step limits", metavar="A:B")
    parser.add_argument(
        "--short", action="store_true", help="few episodes, on two clusters at once"
    )
    parser.add_argument("--seed", type=int, help="seed of the episodes")
    parser.add_argument("--folder", type=Path, help="keep recordings and logs here")
    options = parser.parse_args()
    if reason := missing():
        parser.error(reason)
    chosen = names if "all" in options.drill else options.drill
    seed = options.seed if options.seed is not None else time.time_ns() % 1_000_000
    folder = options.folder or Path(tempfile.mkdtemp(prefix="robotouille-cluster-drill-"))
    say = _teller()
    say(f"seed {seed}, files in {folder}")
    given = {
        "games": options.games,
        "rounds": options.rounds,
        "rate": options.rate,
        "steps": options.steps,
    }
    changes = {name: value for name, value in given.items() if value is not None}
    changes |= {"nodes": options.nodes, "processes": options.processes, "seed": seed}
    work = run_short if options.short else run
    results = asyncio.run(work(chosen, folder, say, lambda plan: replace(plan, **changes)))
    return _report(results)


def _bounds(text: str) -> tuple[int, int]:
    low, _, high = text.partition(":")
    return int(low), int(high)


def _teller() -> Callable[[str], None]:
    begun = time.monotonic()

    def say(text: str) -> None:
        print(f"{time.monotonic() - begun:6.1f}  {text}", flush=True)

    return say


def _report(results: dict[str, Result]) -> int:
    for name, result in results.items():
        print(f"\n{name}\n{aligned(result.rows, result.faults)}")
    return 0 if all(result.ok for result in results.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
