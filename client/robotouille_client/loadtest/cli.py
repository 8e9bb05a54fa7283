"""`robotouille-loadtest`: play on a server with thousands of bots, and tell how it took it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from robotouille.errors import RobotouilleError
from robotouille.program import VersionOption
from robotouille_client.console import (
    SERVER_HOST,
    SERVER_PORT,
    HostOption,
    PortOption,
    UrlOption,
    explain,
    fail,
    failing,
    interruptible,
    server_url,
)
from robotouille_client.loadtest.cores import keep_to_cores, parse_cores

if TYPE_CHECKING:
    from robotouille_client.loadtest.load_test import LoadTest
    from robotouille_client.loadtest.workload import LoadPlan

__all__ = ["main"]


@interruptible
@failing
def command(
    url: UrlOption = None,
    host: HostOption = SERVER_HOST,
    port: PortOption = SERVER_PORT,
    token: Annotated[
        str | None, typer.Option(envvar="ROBOTOUILLE_TOKEN", help="Role token of the bots.")
    ] = None,
    rooms: Annotated[int, typer.Option(help="Episodes at a time, each with all its seats.")] = 100,
    mix: Annotated[
        str, typer.Option(help="Weights of the clocks: realtime:8,lockstep:1,turn:1")
    ] = "realtime",
    rate: Annotated[float, typer.Option(help="Steps (real time) or actions a second.")] = 10.0,
    task: Annotated[str, typer.Option(help="The task of all episodes.")] = "multi_agent/01",
    ramp: Annotated[float, typer.Option(help="Seconds over which the rooms are opened.")] = 10.0,
    duration: Annotated[float, typer.Option(help="Seconds to measure, after the ramp.")] = 30.0,
    processes: Annotated[int, typer.Option(help="Processes that the bots are spread over.")] = 1,
    cpus: Annotated[
        str | None,
        typer.Option(help="Cores for the clients, e.g. 1 or 2-5; not the server's."),
    ] = None,
    storm: Annotated[
        int, typer.Option(help="Connections to cut at once, halfway; they all come back.")
    ] = 0,
    slow_readers: Annotated[
        int, typer.Option(help="Spectators who ask for snapshots and read nothing.")
    ] = 0,
    spectators: Annotated[int, typer.Option(help="Idle spectators of quiet episodes.")] = 0,
    spectators_per_room: Annotated[
        int, typer.Option(help="Of them in one episode; the server has a limit, too.")
    ] = 200,
    pid: Annotated[
        int | None,
        typer.Option(
            min=1, max=2**31 - 1, help="The server's process, where it is not found by its port."
        ),
    ] = None,
    metrics: Annotated[
        str | None,
        typer.Option(help="URL of the server's metrics (default: /metrics on its port)."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of what is random.")] = 0,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the report as JSON to this file.")
    ] = None,
    html_file: Annotated[
        Path | None, typer.Option("--html", help="Write the report with plots to this file.")
    ] = None,
    version: VersionOption = False,
) -> None:
    """Play on a server with thousands of bots at once, and report how it took it.

    Latencies are counted from the moment an action was due by an absolute schedule, whenever it
    could be sent. Ctrl+C ends the test early and reports what was measured so far.
    """
    import asyncio

    from robotouille_client.loadtest.load_test import LoadTest
    from robotouille_client.loadtest.progress import ProgressDisplay

    with _told_by_option():
        _check_files(json_file, html_file)
        cores = parse_cores(cpus)
        plan = _plan(
            url=server_url(url, host, port), rooms=rooms, mix=mix, rate=rate, task=task, ramp=ramp,
            duration=duration, processes=processes, storm=storm, slow_readers=slow_readers,
            spectators=spectators, spectators_per_room=spectators_per_room, seed=seed,
        )  # fmt: skip
        keep_to_cores(cores)
        load_test = LoadTest(
            plan, token=token, pid=pid, metrics=metrics, cpus=cores, progress=ProgressDisplay()
        )
        asyncio.run(load_test.run())
        _report(load_test, json_file, html_file)


@contextmanager
def _told_by_option() -> Iterator[None]:
    """Errors in a line; where a value cannot be that of a plan, its option comes first."""
    from pydantic import ValidationError

    try:
        yield
    except ValidationError as error:
        option, told, why = explain(error).partition(": ")
        fail(f"--{option.replace('_', '-')}{told}{why}", 2)
    except OSError as error:
        fail(f"{error.filename or ''}: {error.strerror or error}".removeprefix(": "))


def _plan(*, mix: str, **options: Any) -> LoadPlan:
    """What is to be done, as the options say."""
    from robotouille_client.loadtest.workload import LoadPlan, parse_mix

    plan = LoadPlan(mix=parse_mix(mix), **options)
    _check(plan)
    return plan


def _report(load_test: LoadTest, json_file: Path | None, html_file: Path | None) -> None:
    """Print what was measured, and write it down where that is asked for."""
    from rich.console import Console

    from robotouille_client.loadtest.report.report import make_report
    from robotouille_client.loadtest.report.terminal_summary import print_summary

    report = make_report(load_test)
    print_summary(report, Console())
    if json_file is not None:
        json_file.write_text(json.dumps(report.to_json(), indent=1) + "\n")
    if html_file is not None:
        from robotouille_client.loadtest.report.html_page import render_page

        html_file.write_text(render_page(report))


def _check(plan: LoadPlan) -> None:
    """What no field can say by itself."""
    from robotouille import World
    from robotouille_client.loadtest.worker.walk import to_and_fro

    if not (plan.rooms or plan.spectators):
        raise RobotouilleError("nothing to do: --rooms or --spectators is needed")
    players = World(plan.task).players
    to_and_fro(plan.task, players[0])
    seats = plan.rooms * len(players)
    if plan.storm > seats:
        raise RobotouilleError(f"--storm: {plan.rooms:,} rooms have only {seats:,} players to cut")
    if plan.slow_readers and not plan.rooms:
        raise RobotouilleError("--slow-readers: they need --rooms to watch")
    if plan.processes > max(plan.rooms, plan.spectators):
        raise RobotouilleError(f"--processes: {plan.processes} are more than there are rooms")


def _check_files(json_file: Path | None, html_file: Path | None) -> None:
    """Better now than after an hour of load."""
    for flag, file in (("--json", json_file), ("--html", html_file)):
        if file is None:
            continue
        if file.is_dir():
            raise RobotouilleError(f"{flag}: {file} is a folder")
        if not file.absolute().parent.is_dir():
            raise RobotouilleError(f"{flag}: there is no folder {file.absolute().parent}")
        if not os.access(file if file.exists() else file.absolute().parent, os.W_OK):
            raise RobotouilleError(f"{flag}: {file} cannot be written")
    if html_file is not None:
        from robotouille_client.loadtest.report.html_page import need_matplotlib

        need_matplotlib()


def main() -> None:
    """The entry point of `robotouille-loadtest`."""
    typer.run(command)


if __name__ == "__main__":
    main()
