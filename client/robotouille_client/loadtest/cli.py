"""Command `robotouille-loadtest`: play with thousands of bots and report the performance."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.errors import RobotouilleError
from robotouille.files.writing import check_file, replace_file
from robotouille.terminal import options_from
from robotouille_client.console import (
    ServerOptions,
    VersionOption,
    explain,
    fail,
    failing,
    interruptible,
)

if TYPE_CHECKING:
    from robotouille_client.loadtest.load_test import LoadTest
    from robotouille_client.loadtest.workload import LoadPlan


@dataclass(frozen=True, kw_only=True)
class LoadOptions(ServerOptions):
    """Options of `robotouille-loadtest`."""

    rooms: Annotated[
        int, typer.Option(help="Number of episodes at a time, each with bots in all seats.")
    ] = 100
    mix: Annotated[
        str, typer.Option(help="Clocks of the episodes and their weights: realtime:8,lockstep:1.")
    ] = "realtime"
    rate: Annotated[
        float, typer.Option(help="Steps (in real time) or actions per second in each episode.")
    ] = 10.0
    task: Annotated[str, typer.Option(help="Task of all episodes.")] = "multi_agent/01"
    ramp: Annotated[float, typer.Option(help="Seconds over which the episodes are opened.")] = 10.0
    duration: Annotated[float, typer.Option(help="Seconds to measure after the ramp.")] = 30.0
    processes: Annotated[int, typer.Option(help="Number of client processes.")] = 1
    cpus: Annotated[
        str | None,
        typer.Option(help="Cores for the clients, such as 1 or 2-5. Does not move the server."),
    ] = None
    storm: Annotated[
        int,
        typer.Option(help="Number of connections to cut at once after half of the duration."),
    ] = 0
    slow_readers: Annotated[
        int,
        typer.Option(help="Number of spectators that request snapshots and read nothing."),
    ] = 0
    spectators: Annotated[
        int, typer.Option(help="Number of idle spectators of quiet episodes.")
    ] = 0
    spectators_per_room: Annotated[
        int,
        typer.Option(help="Number of idle spectators in each episode. The server has a limit too."),
    ] = 200
    pid: Annotated[
        int | None,
        typer.Option(
            min=1, max=2**31 - 1, help="Process id of the server. Default: found by its port."
        ),
    ] = None
    metrics: Annotated[
        str | None,
        typer.Option(help="URL of the server's metrics. Default: /metrics on the server's port."),
    ] = None
    seed: Annotated[int, typer.Option(help="Seed of all random choices.")] = 0
    json_file: Annotated[
        Path | None, typer.Option("--json", help="File for the report as JSON.")
    ] = None
    html_file: Annotated[
        Path | None, typer.Option("--html", help="File for the report as a page with plots.")
    ] = None
    version: VersionOption = False


@interruptible
@failing
@options_from(LoadOptions)
def command(options: LoadOptions) -> None:
    """Play on a server with thousands of bots at once, and report how it performed.

    Latencies count from the time at which an action was due by a fixed schedule, not from the
    time at which it could be sent. Ctrl+C ends the test early and reports the results so far.
    """
    import asyncio

    from robotouille_client.loadtest.load_test import LoadTest, ProgressDisplay
    from robotouille_client.loadtest.worker_pool import keep_to_cores, parse_cores

    with _errors_by_option():
        _check_files(options)
        cores = parse_cores(options.cpus)
        plan = _plan(options)
        keep_to_cores(cores)
        load_test = LoadTest(
            plan,
            token=options.token,
            pid=options.pid,
            metrics=options.metrics,
            cpus=cores,
            progress=ProgressDisplay(),
        )
        asyncio.run(load_test.run())
        _report(load_test, options)


@contextmanager
def _errors_by_option() -> Iterator[None]:
    """Print errors on one line; an invalid value is preceded by its option."""
    from pydantic import ValidationError

    try:
        yield
    except ValidationError as error:
        field, separator, reason = explain(error).partition(": ")
        fail(f"--{field.replace('_', '-')}{separator}{reason}", 2)
    except OSError as error:
        fail(f"{error.filename or ''}: {error.strerror or error}".removeprefix(": "))


def _plan(options: LoadOptions) -> LoadPlan:
    from robotouille_client.loadtest.workload import LoadPlan, parse_mix

    fields = {name: getattr(options, name) for name in LoadPlan.model_fields}
    plan = LoadPlan(**{**fields, "url": options.address, "mix": parse_mix(options.mix)})
    _check(plan)
    return plan


def _report(load_test: LoadTest, options: LoadOptions) -> None:
    from rich.console import Console

    from robotouille_client.loadtest.report import make_report
    from robotouille_client.loadtest.terminal_summary import print_summary

    report = make_report(load_test)
    if options.json_file is not None:
        replace_file(options.json_file, json.dumps(report.to_json(), indent=1) + "\n")
    if options.html_file is not None:
        from robotouille_client.loadtest.html_page import load_test_page

        replace_file(options.html_file, load_test_page(report))
    print_summary(report, Console())


def _check(plan: LoadPlan) -> None:
    # Conditions on several options at once, which no field of the plan can express.
    from robotouille import World
    from robotouille_client.loadtest.players import back_and_forth

    if not (plan.rooms or plan.spectators):
        raise RobotouilleError("nothing to do: use --rooms or --spectators")
    players = World(plan.task).players
    back_and_forth(plan.task, players[0])
    seats = plan.rooms * len(players)
    if plan.storm > seats:
        raise RobotouilleError(f"--storm: {plan.rooms:,} rooms have only {seats:,} players to cut")
    if plan.slow_readers and not plan.rooms:
        raise RobotouilleError("--slow-readers needs --rooms, which they watch")
    if plan.processes > max(plan.rooms, plan.spectators):
        raise RobotouilleError(f"--processes: {plan.processes} is more than the number of rooms")


def _check_files(options: LoadOptions) -> None:
    # A mistake must show now, not after an hour of load.
    for flag, file in (("--json", options.json_file), ("--html", options.html_file)):
        if file is not None:
            check_file(file, flag)
    if options.html_file is not None:
        from robotouille.html_report import require_libraries

        require_libraries("--html", "load")


def main() -> None:
    """Run `robotouille-loadtest`."""
    typer.run(command)


if __name__ == "__main__":
    main()
