"""Summary of a load test for a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from robotouille.terminal import printable
from robotouille_client.loadtest.report import DURATIONS, LoadReport, memory_each

COLUMNS = ("p50", "p90", "p99", "p99.9", "max")


def print_summary(report: LoadReport, console: Console) -> None:
    """Print the main figures on one screen."""
    console.print(Group(*_parts(report)))


def _parts(report: LoadReport) -> Iterator[RenderableType]:
    plan, figures = report.plan, report.figures
    yield Text(f"{printable(figures['server']) or 'a server'} at {plan.url}", style="bold")
    facts_table = Table.grid(padding=(0, 2))
    for name, value in facts(report):
        facts_table.add_row(Text(name, style="dim"), Text(printable(value)))
    yield facts_table
    yield Text()
    yield _durations(report)
    for note in report.notes:
        yield Text(printable(f"! {note}"), style="yellow")


def _durations(report: LoadReport) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("milliseconds")
    for column in (*COLUMNS, "count"):
        table.add_column(column, justify="right")
    for name, title in DURATIONS.items():
        row = report.figures["durations"].get(name)
        if row:
            cells = [milliseconds(row[column]) for column in COLUMNS]
            table.add_row(title, *cells, f"{row['count']:,}")
    return table


def facts(report: LoadReport) -> list[tuple[str, str]]:
    """Return all figures that are not distributions, as names and values in words."""
    plan, figures = report.plan, report.figures
    mix = ", ".join(f"{n:,} {clock}" for clock, n in plan.rooms_by_clock().items())
    rows = [
        ("load", f"{mix} rooms at {plan.rate:g} actions/s, for {figures['seconds']:.0f} s"),
        (
            "at the end",
            f"{figures['rooms playing']:,} rooms, {figures['connections']:,} connections",
        ),
    ]
    rows += _step_facts(figures["steps"])
    traffic = figures["traffic"]
    if "bytes in a second" in traffic:
        rows.append(("traffic", "; ".join(_flows(traffic))))
    rows += _process_facts(report)
    rows += _storm_facts(figures["storm"])
    clients = figures["clients"]["busiest process, of a core"]
    rows.append(
        ("clients", f"{plan.processes} processes; the busiest used {clients:.0%} of a core")
    )
    if figures["counts"]:
        counted = ", ".join(f"{name} {n:,.0f}" for name, n in figures["counts"].items())
        rows.append(("counts", counted))
    return rows


def _step_facts(steps: dict[str, Any]) -> list[tuple[str, str]]:
    rows = []
    if steps["rate held"] is not None:
        held = f"{steps['rate held']:.2%} of the nominal rate ({steps['seen']:,.0f} received)"
        rows.append(("steps", held))
        rows.append(("deltas on arrival", _shares(steps["seen within"])))
    if server := steps.get("by the server"):
        text = _shares(server["within"])
        rows.append(("steps at the server", f"{text}; median {milliseconds(server['p50'])} ms"))
    if sent := steps.get("age when sent"):
        both = f"median {milliseconds(sent['p50'])} ms, p99 {milliseconds(sent['p99'])} ms"
        rows.append(("deltas when sent", f"{both} after their step"))
    return rows


def _shares(within: dict[str, float | None]) -> str:
    known = [(limit, share) for limit, share in within.items() if share is not None]
    return (
        ", ".join(f"{share:.2%} < {float(limit) * 1000:g} ms" for limit, share in known) + " late"
    )


def _flows(traffic: dict[str, float]) -> Iterator[str]:
    for way, title in (("out", "to the server"), ("in", "from the server")):
        messages = traffic[f"messages {way} a second"]
        size = traffic[f"bytes {way} a second"] / 1024
        yield f"{messages:,.0f} messages/s, {size:,.0f} KiB/s {title}"


def _process_facts(report: LoadReport) -> list[tuple[str, str]]:
    process = report.figures["server process"]
    if process is None:
        return []
    memory = process["memory at"]
    text = f"{process['cores used']:.2f} cores, {process['memory'] / 2**20:,.0f} MiB"
    if "empty" in memory and "rooms" in memory and report.plan.rooms:
        each = (memory["rooms"] - memory["empty"]) / report.plan.rooms / 1024
        text += f"; {each:,.0f} KiB per room"
    each_spectator = memory_each(report.plan, memory)
    if each_spectator is not None:
        text += f"; {each_spectator / 1024:,.1f} KiB per idle spectator"
    return [("server", text)]


def _storm_facts(storm: dict[str, Any] | None) -> list[tuple[str, str]]:
    if storm is None:
        return []
    text = f"{storm['back']:,} of {storm['cut']:,} cut connections returned to their seats"
    if storm["over after"] is not None:
        text += f", the last after {storm['over after']:.2f} s"
    return [("storm", text)]


def milliseconds(seconds: float | None) -> str:
    """Return seconds as milliseconds with about three significant digits."""
    if seconds is None:
        return "?"
    value = seconds * 1000
    return f"{value:.2f}" if value < 10 else f"{value:,.1f}" if value < 100 else f"{value:,.0f}"
