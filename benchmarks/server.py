"""Compare the server with a bare `websockets` server in one run.

Each server runs on one core, and the clients of the load test run on the others. Both serve the
same bots at the same rates with messages of the same size, but the bare server simulates no world.
Run the benchmark on an idle machine: on two cores, any other program invalidates the results.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rich.console import Console
from rich.table import Table

from benchmarks.flat import Growth, memory_over_steps
from robotouille_client.loadtest.html_page import load_test_page
from robotouille_client.loadtest.load_test import LoadTest, ProgressDisplay
from robotouille_client.loadtest.report import LoadReport, make_report, memory_each
from robotouille_client.loadtest.terminal_summary import milliseconds
from robotouille_client.loadtest.worker_pool import keep_to_cores
from robotouille_client.loadtest.workload import LoadPlan, parse_mix

OURS, BARE = "robotouille-server", "bare websockets"
LATE = "0.05"
MIX = "realtime:20,lockstep:1"
"""One lockstep room per 20 real-time rooms. It answers actions at once, so it measures the round
trip."""
STEPS, ENOUGH = 10_000_000, 0.95
"""Steps over which memory must stay flat, and the share of them that is enough. A run takes
slightly fewer steps, because ending and starting episodes takes time, too."""


@dataclass(frozen=True)
class Build:
    """A checkout, the Python that runs it, and extra environment variables and flags."""

    tree: Path = Path(__file__).resolve().parents[1]
    python: str = sys.executable
    environment: Mapping[str, str] = field(default_factory=dict)
    flags: tuple[str, ...] = ()

    def variables(self) -> dict[str, str]:
        """Return environment variables with which Python imports the packages of the tree."""
        folders = [str(self.tree / name) for name in ("shared", "server", "client", "data")]
        # Libraries may be there, too.
        folders += filter(None, [os.environ.get("PYTHONPATH")])
        return {"PYTHONPATH": os.pathsep.join(folders), **self.environment}


@dataclass(frozen=True)
class Bench:
    """Duration of a measurement, folder for reports, the cores, and the build of our server."""

    seconds: float
    out: Path | None
    servers: tuple[int, ...]
    clients: tuple[int, ...]
    console: Console
    build: Build = Build()

    @property
    def processes(self) -> int:
        return max(1, min(4, len(self.clients)))


@dataclass(frozen=True)
class Row:
    """Result of both servers with its target."""

    name: str
    target: str
    ours: str
    bare: str
    met: bool | None = None


def own_cores() -> tuple[int, ...]:
    """Return the cores on which this process may run."""
    if hasattr(os, "sched_getaffinity"):
        return tuple(sorted(os.sched_getaffinity(0)))
    return tuple(range(os.cpu_count() or 1))


@contextmanager
def server(which: str, bench: Bench, *flags: str) -> Iterator[tuple[int, str]]:
    """Run a server process on its cores; yield its process id and its URL."""
    build = bench.build
    with tempfile.TemporaryDirectory() as folder:
        command = [build.python, "-m", "benchmarks.bare"]
        if which == OURS:
            program = "from robotouille_server.cli import main; main()"
            command = [
                build.python, "-c", program, "--port", "0", "--recordings", f"{folder}/r",
                "--max-episodes", "10000", "--max-spectators", "1000", "--log-level", "error",
                "--no-operator", *flags, *build.flags,
            ]  # fmt: skip
        with running(command, bench, build.tree, build.variables()) as found:
            yield found


@contextmanager
def running(
    command: list[str], bench: Bench, folder: Path, environment: Mapping[str, str]
) -> Iterator[tuple[int, str]]:
    """Run a program on the servers' cores; yield its process id and the URL that it prints."""
    with _on_cores(bench.servers):
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, cwd=folder,
            env={**os.environ, **environment},
        )  # fmt: skip
    with process:
        try:
            yield process.pid, _url(process)
        finally:
            _stop(process)


@contextmanager
def _on_cores(cores: tuple[int, ...]) -> Iterator[None]:
    """Start programs on these cores. All their threads inherit the cores."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    own = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, own)


def _stop(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.wait(timeout=20)
    except subprocess.TimeoutExpired:
        process.kill()


def _url(process: subprocess.Popen[str]) -> str:
    for line in process.stdout or ():
        found = re.search(r"ws://\S+", line)
        if found:
            return found[0]
    raise SystemExit("the server did not start")


def load(
    which: str, bench: Bench, title: str, flags: tuple[str, ...] = (), **plan: Any
) -> LoadReport:
    """Run one load test against a new server."""
    bench.console.print(f"[bold]{title}[/], {which}", highlight=False)
    with server(which, bench, *flags) as (pid, url):
        options = {"duration": bench.seconds, "processes": bench.processes, **plan}
        test = LoadPlan(url=url, **options)
        conductor = LoadTest(test, pid=pid, cpus=bench.clients, progress=ProgressDisplay())
        asyncio.run(conductor.run())
        report = make_report(conductor)
    if bench.out is not None:
        name = re.sub(r"\W+", "-", f"{title} {which}").strip("-")
        (bench.out / f"{name}.json").write_text(json.dumps(report.to_json(), indent=1))
        (bench.out / f"{name}.html").write_text(load_test_page(report))
    for note in report.notes:
        bench.console.print(f"  ! {note}", style="yellow", highlight=False)
    return report


# Real time


def realtime(bench: Bench, rooms: int, rate: float) -> list[Row]:
    """Measure real-time episodes for two players, with one lockstep episode per twenty."""
    title = f"{rooms:,} real-time episodes at {rate:g} steps/s"
    both = {
        which: load(which, bench, title, rooms=rooms * 21 // 20, rate=rate, mix=parse_mix(MIX),
                    ramp=rooms / 60)
        for which in (BARE, OURS)
    }  # fmt: skip
    ours, bare = both[OURS], both[BARE]
    return [
        *_steps(title, ours, bare),
        *_echo(ours, bare),
        Row("  cores used", "", _cores(ours), _cores(bare)),
    ]


def _steps(title: str, ours: LoadReport, bare: LoadReport) -> list[Row]:
    late = [_late(report) for report in (ours, bare)]
    held = [report.figures["steps"]["rate held"] or 0.0 for report in (ours, bare)]
    ages = [report.figures["durations"].get("delta age") for report in (ours, bare)]
    arrived = [milliseconds(age["p50"]) if age else "?" for age in ages]
    sent = ours.figures["steps"].get("age when sent")
    age = sent["p50"] if sent else None
    return [
        Row(f"{title}: steps less than 50 ms late", "99.9 %", _share(late[0]), _share(late[1]),
            met=late[0] >= 0.999),
        Row("  nominal rate held", "100 %", _share(held[0]), _share(held[1]),
            met=held[0] >= 0.995),
        Row("  age of deltas when sent, median, ms", "1", milliseconds(age), "",
            met=age is not None and age <= 0.001),
        Row("  age of deltas on arrival, median, ms", "", arrived[0], arrived[1]),
    ]  # fmt: skip


def _late(report: LoadReport) -> float:
    """Return the share of steps that the server took in time, by its own count."""
    own = report.figures["steps"].get("by the server")
    return (own["within"][LATE] or 0.0) if own else 0.0


def _echo(ours: LoadReport, bare: LoadReport) -> list[Row]:
    rows = []
    for key, name in (("p50", "median"), ("p99", "99 %")):
        times = [r.figures["durations"].get("action, lockstep", {}).get(key) for r in (ours, bare)]
        ratio = times[0] / times[1] if times[0] and times[1] else None
        shown = f"{milliseconds(times[0])} ({ratio:.1f} ×)" if ratio else "?"
        rows.append(Row(f"  action to delta, {name}, ms", "2 × bare", shown, milliseconds(times[1]),
                        met=ratio is not None and ratio <= 2))  # fmt: skip
    return rows


def _share(share: float) -> str:
    return f"{share:.2%}"


def _cores(report: LoadReport) -> str:
    process = report.figures["server process"]
    return f"{process['cores used']:.2f}" if process else "?"


# Spectators, storm, workers, memory


def spectators(bench: Bench, count: int) -> list[Row]:
    """Measure the memory of idle spectators."""
    title = f"{count:,} idle spectators"
    shown, met = {}, None
    for which in (BARE, OURS):
        report = load(which, bench, title, rooms=0, spectators=count, ramp=count / 400)
        each = memory_each(report.plan, report.observed.memory)
        shown[which] = f"{each / 1024:.1f}" if each is not None else "?"
        if which == OURS:
            met = each is not None and each <= 64 * 1024
    return [Row(f"{title}, KiB each", "64", shown[OURS], shown[BARE], met)]


def storm(bench: Bench, count: int) -> list[Row]:
    """Measure recovery after all players lose their connections at the same time."""
    title = f"storm of {count:,} connections"
    shown, met = {}, None
    for which in (BARE, OURS):
        report = load(which, bench, title, rooms=count // 2, rate=1, storm=count, ramp=count / 120)
        found = report.figures["storm"] or {}
        over = found.get("over after")
        shown[which] = f"{over:.2f}" if over is not None else f"{found.get('back', 0)} came back"
        if which == OURS:
            met = over is not None and over <= 5
    return [Row(f"{title}: seconds until all are back", "5", shown[OURS], shown[BARE], met)]


def workers(bench: Bench, rooms: int, rate: float) -> list[Row]:
    """Measure two worker processes that share the port."""
    title = f"{rooms:,} episodes at {rate:g} steps/s, two workers"
    own = bench.clients
    cores = bench.servers + (own[-1:] if len(own) > 1 else ())
    wide = Bench(bench.seconds, bench.out, cores, bench.clients, bench.console)
    report = load(OURS, wide, title, ("--workers", "2"), rooms=rooms, rate=rate, ramp=rooms / 60)
    age = report.figures["durations"].get("delta age")
    within = report.figures["steps"]["seen within"][LATE] if age else 0.0
    return [Row(f"{title}: deltas less than 50 ms late", "99.9 %", _share(within), "",
                met=within >= 0.999)]  # fmt: skip


def memory(bench: Bench, steps: int) -> list[Row]:
    """Measure the server's memory over many steps."""
    bench.console.print(f"[bold]memory over {steps:,} steps[/]", highlight=False)
    return [memory_row(memory_over_steps(steps))]


def memory_row(growth: Growth) -> Row:
    """Return the row for memory. A run that is too short can miss the target but not meet it."""
    name = f"memory over {growth.steps:,} steps, MiB"
    shown = f"{growth.first / 2**20:.1f} → {growth.last / 2**20:.1f}"
    met = None if growth.flat and growth.steps < ENOUGH * STEPS else growth.flat
    return Row(name, f"flat over {STEPS:,}", shown, "", met)


def print_rows(rows: list[Row], console: Console) -> None:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("")
    for column in ("target", OURS, BARE, ""):
        table.add_column(column, justify="right")
    for row in rows:
        mark = {True: "[green]✓[/]", False: "[red]✗[/]", None: ""}[row.met]
        table.add_row(row.name, row.target, row.ours, row.bare, mark)
    console.print(table)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="seconds of each measurement")
    parser.add_argument("--scale", type=float, default=1.0, help="factor for the number of clients")
    parser.add_argument(
        "--steps", type=int, default=1_000_000, help=f"steps of the memory test (target: {STEPS:,})"
    )
    parser.add_argument("--out", type=Path, help="folder for JSON and HTML reports")
    parser.add_argument(
        "--only", nargs="*", choices=("realtime", "spectators", "storm", "workers", "memory")
    )
    options = parser.parse_args(arguments)
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
    everyone = own_cores()
    clients = everyone[1:] or everyone
    bench = Bench(options.seconds, options.out, everyone[:1], clients, Console())
    keep_to_cores(clients if hasattr(os, "sched_setaffinity") else ())
    wanted = options.only or ["realtime", "spectators", "storm", "workers", "memory"]
    scale, rows = options.scale, list[Row]()
    if "realtime" in wanted:
        rows += realtime(bench, round(1500 * scale), 5)
        rows += realtime(bench, round(1000 * scale), 10)
    if "spectators" in wanted:
        rows += spectators(bench, round(10_000 * scale))
    if "storm" in wanted:
        rows += storm(bench, round(2000 * scale))
    if "workers" in wanted:
        rows += workers(bench, round(1000 * scale), 10)
    if "memory" in wanted:
        rows += memory(bench, options.steps)
    print_rows(rows, bench.console)


if __name__ == "__main__":
    main()
