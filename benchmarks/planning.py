"""Measure optimal planning of default tasks and generated instances, and planning for play.

    python -m benchmarks.planning           # compiled kernels if the extra `fast` is installed
    ROBOTOUILLE_COMPILE=0 python -m benchmarks.planning

`make bench` prints both columns. Times are for one process and exclude compilation.
"""

from __future__ import annotations

import json
import os
import random
import statistics
import subprocess
import sys
import time
from collections.abc import Iterable
from functools import partial
from pathlib import Path

from robotouille import World, load_task
from robotouille.installation import data_folder
from robotouille.planning.kitchen.kernels import COMPILED
from robotouille.planning.plan import Limits
from robotouille.planning.solvers import AnytimePlanner, solve

ROOT = Path(__file__).resolve().parents[1]
SINGLE = ("synchronous", "asynchronous")
SECONDS = 30.0
STATES = 6_000_000
"""Maximum number of states in memory, which keeps the process below 2 GB."""


def defaults() -> list[str]:
    """Return the twenty default tasks for one player."""
    return [f"{folder}/{number:02d}" for folder in SINGLE for number in range(1, 11)]


def generated() -> list[str]:
    """Return the generated instances for one player."""
    root = data_folder("problems")
    files = [p for f in SINGLE for p in sorted((root / "generated" / f).glob("*_s*.json"))]
    named = [p.relative_to(root).with_suffix("").as_posix() for p in files]
    return [name for name in named if not name.endswith(".certificate")]


def over(deadline: float) -> bool:
    """Return whether the deadline has passed."""
    return time.perf_counter() > deadline


def certify(names: Iterable[str]) -> list[tuple[float, bool, int]]:
    """Search each task; return its seconds, whether the plan is proven shortest, and expansions."""
    rows = []
    for name in names:
        begun = time.perf_counter()
        late = begun + SECONDS
        limits = Limits(states=STATES, stop=partial(over, late))
        answer = solve(World(load_task(name)), limits=limits)
        rows.append((time.perf_counter() - begun, answer.optimal, answer.expansions))
    return rows


def first_plans() -> list[tuple[float, float]]:
    """Return, per default task, the seconds to the first plan for play and its relative length."""
    rows = []
    for name in defaults():
        world = World(load_task(name))
        best = solve(world)
        begun = time.perf_counter()
        plan = AnytimePlanner(world).first(world.initial).plan
        rows.append((time.perf_counter() - begun, len(plan or ()) / best.bound))
    return rows


def transitions(name: str = "asynchronous/09", steps: int = 20_000) -> float:
    """Return the world's steps per second, with listing of actions, to compare with expansions."""
    world, dice = World(load_task(name)), random.Random(1)
    state = world.initial
    for _ in range(2):
        begun = time.perf_counter()
        for _ in range(steps):
            state = world.successor(state, dice.choice(state.actions(world.players[0])))
        spent = time.perf_counter() - begun
    return steps / spent


def measure() -> dict[str, str]:
    """Return all results as text by name."""
    certify(defaults()[:1])
    rows = certify(defaults())
    many = certify(generated())
    plans = first_plans()
    times = sorted(seconds for seconds, _, _ in many)
    expansions = sum(count for _, _, count in many)
    proven = sum(optimal for _, optimal, _ in many)
    return {
        "20 default tasks certified": f"{sum(r[0] for r in rows):.2f} s",
        "proven": f"{sum(r[1] for r in rows)} of {len(rows)}",
        f"{len(many)} generated instances, median": f"{statistics.median(times):.3f} s",
        "95th percentile": f"{times[int(0.95 * len(times))]:.2f} s",
        "slowest": f"{times[-1]:.1f} s",
        "total": f"{sum(times):.0f} s",
        f"proven within {SECONDS:.0f} s": f"{proven} ({proven / len(many):.1%})",
        "expansions/s": f"{expansions / sum(times):,.0f}",
        "world steps/s": f"{transitions():,.0f}",
        "first plan for play, slowest": f"{max(p[0] for p in plans) * 1e3:.0f} ms",
        "its length / optimum, worst": f"{max(p[1] for p in plans):.2f}",
    }


def elsewhere(compiled: bool) -> dict[str, str]:
    """Measure in a separate process, with compiled kernels or in plain Python."""
    environment = {**os.environ, "ROBOTOUILLE_COMPILE": "1" if compiled else "0"}
    command = [sys.executable, "-m", "benchmarks.planning", "--json"]
    result = subprocess.run(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, check=True)
    figures: dict[str, str] = json.loads(result.stdout)
    return figures


def main() -> None:
    if "--json" in sys.argv:
        print(json.dumps(measure()))
        return
    columns = {"plain Python": elsewhere(compiled=False)}
    if COMPILED:
        columns["compiled"] = elsewhere(compiled=True)
    print("Planning, one process" + ("" if COMPILED else " (the extra `fast` is not installed)"))
    print(" " * 36 + "".join(title.rjust(16) for title in columns))
    for name in next(iter(columns.values())):
        print(name.ljust(36) + "".join(column[name].rjust(16) for column in columns.values()))


if __name__ == "__main__":
    main()
