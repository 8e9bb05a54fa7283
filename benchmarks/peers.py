"""Compare the server with Colyseus on Node, or two builds of the server with each other.

    python -m benchmarks.peers --rooms 300 --rate 5 --seconds 15 --runs 3
    python -m benchmarks.peers --without-colyseus --a tree=../before --b tree=../after

The servers are measured in turns in one run, so that other load on the machine affects all of
them. Each runs on the first core of this process, and the clients run on its other cores. Each
room has two players: one sends one input per step, and the other watches. Both servers check the
inputs and append each step to the room's file before they send it. `benchmarks/colyseus` has the
room and the bots.

The clients of this server count a step as late if it arrives 50 ms after the room's schedule. The
rooms of Colyseus have no schedule, because each interval begins when the previous one was handled.
A step of Colyseus is late if it arrives 50 ms more than an interval after the previous step.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rich.console import Console
from rich.table import Table

from benchmarks.server import BARE, LATE, OURS, Bench, Build, load, own_cores, running
from robotouille_client.loadtest.load_test import SETTLE_SECONDS
from robotouille_client.loadtest.report import BUSY_LIMIT, LAG_LIMIT
from robotouille_client.loadtest.server_monitor import ServerProcess, ServerSample
from robotouille_client.loadtest.worker_pool import keep_to_cores

PROGRAMS = Path(__file__).resolve().parent / "colyseus"
COLYSEUS = "Colyseus"


@dataclass(frozen=True)
class Work:
    """Load that all servers get."""

    rooms: int
    rate: float
    ramp: float

    @property
    def title(self) -> str:
        return f"{self.rooms:,} rooms at {self.rate:g} steps/s"


Figures = dict[str, float]
"""Results of one run of a server, by the row of the table. The processor time until all rooms run
counts from the first connection to the measurement, and includes the steps in this time."""


def measure_ours(bench: Bench, work: Work, which: str = OURS) -> Figures:
    """Measure a build of the server, or the bare server, with the load test."""
    report = load(which, bench, work.title, rooms=work.rooms, rate=work.rate, ramp=work.ramp)
    steps, traffic = report.figures["steps"], report.figures["traffic"]
    process, samples = report.figures["server process"], report.observed.samples
    opening = cpu_at(samples, report.observed.begun) - samples[0].cpu
    return {
        "cores used": process["cores used"],
        "CPU per step, µs": process["cores used"] * report.figures["seconds"] / steps["seen"] * 1e6,
        "memory, MiB": process["memory"] / 2**20,
        "CPU until all rooms run, ms/room": opening / work.rooms * 1e3,
        "steps per second": steps["seen"] / report.figures["seconds"],
        "steps done, of those due, %": steps["rate held"] * 100,
        "steps less than 50 ms late, %": steps["seen within"][LATE] * 100,
        "messages/s to clients": traffic["messages in a second"],
        "KiB/s to clients": traffic["bytes in a second"] / 1024,
    }


def cpu_at(samples: Sequence[ServerSample], at: float) -> float:
    """Return the processor time at a time between two samples."""
    for one, other in pairwise(samples):
        if one.at <= at <= other.at:
            return one.cpu + (other.cpu - one.cpu) * (at - one.at) / (other.at - one.at)
    return samples[-1].cpu


def install(console: Console) -> Path | None:
    """Return a folder with the programs and libraries of Colyseus, or None without Node."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    wanted = hashlib.sha256((PROGRAMS / "package.json").read_bytes()).hexdigest()[:12]
    folder = cache / "robotouille-benchmarks" / f"colyseus-{wanted}"
    needed = ("node",) if (folder / ".installed").is_file() else ("node", "npm")
    if missing := [name for name in needed if shutil.which(name) is None]:
        console.print(f"{' and '.join(missing)} not found: comparing with {BARE}", style="yellow")
        return None
    # The programs are copied, because Node looks for libraries next to the program only.
    shutil.copytree(PROGRAMS, folder, dirs_exist_ok=True)
    if (folder / ".installed").is_file():
        return folder
    console.print(f"installing Colyseus with npm into {folder}", highlight=False)
    command = ["npm", "install", "--no-package-lock", "--ignore-scripts", "--no-audit", "--no-fund"]
    done = subprocess.run(command, check=False, cwd=folder, capture_output=True, text=True)
    if done.returncode:
        console.print(f"npm failed: comparing with {BARE}\n{done.stderr[-500:]}", style="yellow")
        return None
    (folder / ".installed").touch()
    return folder


def measure_colyseus(bench: Bench, work: Work, folder: Path) -> Figures:
    """Measure Colyseus with bots that run on the clients' cores."""
    bench.console.print(f"[bold]{work.title}[/], {COLYSEUS}", highlight=False)
    with tempfile.TemporaryDirectory() as files:
        command = ["node", "server.mjs", files, f"{work.rate:g}"]
        with running(command, bench, folder, {"NODE_ENV": "production"}) as (pid, url):
            numbers = (work.rooms, work.rate, work.ramp, SETTLE_SECONDS, bench.seconds)
            bots = ["node", "clients.mjs", url, *map(str, numbers)]
            process = ServerProcess(pid)
            samples = [process.sample()]
            with subprocess.Popen(bots, stdout=subprocess.PIPE, text=True, cwd=folder) as clients:
                lines = []
                for line in clients.stdout or ():
                    lines.append(line)
                    samples.append(process.sample())
    if len(lines) != 2 or not all(samples):
        raise SystemExit("the bots of Colyseus or its server failed")
    first, begin, end = (sample for sample in samples if sample)
    found = json.loads(lines[-1])
    _warn(bench.console, found, work)
    cores = (end.cpu - begin.cpu) / (end.at - begin.at)
    seconds, steps = found["seconds"], found["steps"]
    return {
        "cores used": cores,
        "CPU per step, µs": cores * seconds / steps * 1e6,
        "memory, MiB": end.memory / 2**20,
        "CPU until all rooms run, ms/room": (begin.cpu - first.cpu) / work.rooms * 1e3,
        "steps per second": steps / seconds,
        "steps done, of those due, %": steps / (seconds * work.rate * work.rooms) * 100,
        "steps less than 50 ms late, %": found["onTime"] / steps * 100,
        "messages/s to clients": found["received"] / seconds,
        "KiB/s to clients": found["bytesIn"] / seconds / 1024,
    }


def _warn(console: Console, found: dict[str, Any], work: Work) -> None:
    # Our server, too, refuses a few inputs that arrive after the state has changed.
    if found["rooms"] < work.rooms or found["rejected"] > 0.01 * found["inputs"]:
        shown = {name: found[name] for name in ("rooms", "inputs", "rejected", "problems")}
        console.print(f"  ! {shown}", style="yellow", highlight=False)
    if found["lag"] > LAG_LIMIT or found["cores"] > BUSY_LIMIT:
        slow = f"lag {found['lag'] * 1000:.1f} ms (p99), {found['cores']:.0%} of a core"
        console.print(f"  ! The clients themselves were slow: {slow}", style="yellow")


def measure(sides: dict[str, Callable[[], Figures]], runs: int) -> dict[str, list[Figures]]:
    """Measure all sides in turns, in the opposite order in every other round."""
    results: dict[str, list[Figures]] = {name: [] for name in sides}
    for number in range(runs):
        for name in list(sides)[:: -1 if number % 2 else 1]:
            results[name].append(sides[name]())
    return results


def table(results: dict[str, list[Figures]]) -> Table:
    """Return medians with ranges: of each side, and of the ratios within each round."""
    first, *others = results
    shown = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    shown.add_column("", no_wrap=True)
    for column in (*results, *(f"{first} / {other}" for other in others)):
        shown.add_column(column, justify="right", no_wrap=True)
    for title in results[first][0]:
        values = {name: [figures[title] for figures in of] for name, of in results.items()}
        pairs = [zip(values[first], values[other], strict=True) for other in others]
        digits = 2 if title.endswith("%") else None
        cells = [_spread(of, digits) for of in values.values()]
        shown.add_row(title, *cells, *(_spread([a / b for a, b in pair], 2) for pair in pairs))
    return shown


def _spread(values: Sequence[float], digits: int | None = None) -> str:
    middle = median(values)
    if digits is None:
        digits = max(0, 3 - len(f"{middle:.0f}".lstrip("0")))
    if len(values) == 1:
        return f"{middle:.{digits}f}"
    return f"{middle:.{digits}f} ({min(values):.{digits}f}–{max(values):.{digits}f})"


def parse_build(text: str) -> Build:
    """Return the build that words like `tree=PATH python=PATH NAME=VALUE --flag value` describe."""
    known, variables, flags = dict[str, str](), dict[str, str](), list[str]()
    for word in shlex.split(text):
        name, equals, value = word.partition("=")
        if not equals or not name.isidentifier():
            flags.append(word)
        elif name in ("tree", "python"):
            known[name] = value
        else:
            variables[name] = value
    tree = Path(known.get("tree", Build.tree)).resolve()
    if not (tree / "server" / "robotouille_server").is_dir():
        raise argparse.ArgumentTypeError(f"{tree} is not a checkout of Robotouille")
    return Build(tree, known.get("python", Build.python), variables, tuple(flags))


def main(arguments: list[str] | None = None) -> None:
    style = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=style)
    parser.add_argument("--rooms", type=int, default=300, help="number of rooms (300)")
    parser.add_argument("--rate", type=float, default=5.0, help="steps per second (5)")
    parser.add_argument("--seconds", type=float, default=15.0, help="seconds of each run (15)")
    parser.add_argument("--runs", type=int, default=3, help="number of runs of each server (3)")
    spec = "build of this server: tree=PATH python=PATH NAME=VALUE --flag value, all optional"
    parser.add_argument("--a", type=parse_build, default=Build(), metavar="BUILD", help=spec)
    parser.add_argument("--b", type=parse_build, metavar="BUILD", help="second build, like --a")
    parser.add_argument("--without-colyseus", action="store_true", help="measure only the builds")
    options = parser.parse_args(arguments)
    cores = own_cores()
    clients = cores[1:] or cores
    # A file or pipe gets whole lines.
    console = Console(width=None if sys.stdout.isatty() else 160)
    bench = Bench(options.seconds, None, cores[:1], clients, console)
    keep_to_cores(clients if hasattr(os, "sched_setaffinity") else ())
    work = Work(options.rooms, options.rate, max(1.0, options.rooms / 60))
    builds = {"A": options.a, "B": options.b} if options.b else {"Robotouille": options.a}
    for name, build in builds.items():
        variables = map("=".join, build.environment.items())
        console.print(f"{name}: {build.tree}", *variables, *build.flags, highlight=False)
    sides: dict[str, Callable[[], Figures]] = {
        name: partial(measure_ours, replace(bench, build=build), work)
        for name, build in builds.items()
    }
    if not options.without_colyseus:
        folder = install(console)
        peer = partial(measure_colyseus, bench, work, folder) if folder else None
        sides[COLYSEUS if peer else BARE] = peer or partial(measure_ours, bench, work, BARE)
    console.print(table(measure(sides, options.runs)))


if __name__ == "__main__":
    main()
