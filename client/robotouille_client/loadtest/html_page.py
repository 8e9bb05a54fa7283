"""HTML page of a load test, with plots."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING

from robotouille.html_report.figures import (
    COLOURS,
    SOFT,
    ReportFigure,
    draw_figure,
    legend_above,
)
from robotouille.html_report.page import FigureGrid, Page, Section, Table, TableRow, render_page
from robotouille_client.loadtest.histogram import Histogram
from robotouille_client.loadtest.report import DURATIONS, LoadReport
from robotouille_client.loadtest.terminal_summary import facts, milliseconds

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDE, NARROW = (10.6, 3.6), (5.6, 3.0)
"""Sizes in inches."""
SPECTRA = ("action, realtime", "action, lockstep", "action, turn", "delta age", "ping")
COLUMNS = ("p50", "p90", "p99", "p99.9", "p99.99", "max")
RED = "#d55e00"
FOOTER = (
    "Each duration begins at the time when an absolute schedule required the message, not when "
    "the client could send it. A server that stalls is therefore sampled as often as a fast one. "
    "In real time, the wait for the next step is subtracted: an action is compared with the first "
    "step that was due after it, so an action that misses its step costs a whole period. The due "
    "times of steps are estimated from the earliest arrival in each episode, and ages are relative "
    "to that arrival. The shaded part of a plot is the ramp."
)


def load_test_page(report: LoadReport) -> str:
    """Return the HTML of the page."""
    figures = report.figures
    machine = figures["machine"]
    grid = FigureGrid(list(_plots(report)))
    spectra = [_spectra(report)] if any(_count(report, name) for name in SPECTRA) else []
    page = Page(
        f"Load test of {figures['server'] or 'a server'}",
        " · ".join([
            figures["when"], report.plan.url,
            f"{machine['cores']} cores, {machine['system']}, Python {machine['python']}",
        ]),
        list(_cards(report)),
        report.notes,
        [
            Section("durations", "Durations in milliseconds", "", [_durations(report), *spectra]),
            Section("plots", "Plots", "", [grid] if grid.figures else []),
            Section("figures", "Figures", "", [_facts(report)]),
        ],
        FOOTER,
    )  # fmt: skip
    return render_page(page)


def _cards(report: LoadReport) -> Iterator[tuple[str, str]]:
    figures = report.figures
    steps, durations = figures["steps"], figures["durations"]
    yield f"{figures['rooms playing']:,}", "rooms played"
    if steps["rate held"] is not None:
        yield f"{steps['rate held']:.1%}", "of the nominal step rate"
    server = steps.get("by the server")
    if server and server["within"].get("0.05") is not None:
        yield f"{server['within']['0.05']:.2%}", "of steps less than 50 ms late"
    for clock in ("lockstep", "realtime", "turn"):
        if found := durations.get(f"action, {clock}"):
            yield f"{milliseconds(found['p99'])} ms", f"{clock}: action to delta, p99"
    if storm := figures["storm"]:
        over = storm["over after"]
        yield f"{over:.2f} s" if over is not None else "not over", "until the storm was over"
    if process := figures["server process"]:
        yield f"{process['cores used']:.2f}", "cores used by the server"
        yield f"{process['memory'] / 2**20:,.0f} MiB", "memory of the server"


def _durations(report: LoadReport) -> Table:
    found = ((title, report.figures["durations"].get(key)) for key, title in DURATIONS.items())
    rows = [
        TableRow((title, *(milliseconds(row[each]) for each in COLUMNS), f"{row['count']:,}"))
        for title, row in found
        if row is not None
    ]
    return Table(("duration", *COLUMNS, "count"), rows)


def _facts(report: LoadReport) -> Table:
    rows = [TableRow(row) for row in facts(report)]
    return Table(("figure", "value"), rows, words=frozenset({"value"}), wrap=True)


# Plots


def _count(report: LoadReport, name: str) -> int:
    return report.measured.duration(name).count


def _plots(report: LoadReport) -> Iterator[ReportFigure]:
    """Yield the plots for which there is data."""
    server = report.figures["steps"].get("by the server")
    returned = report.measured.duration("return")
    if any("delta age" in row for row in report.series):
        yield _plot("ages", "Age of deltas on arrival", lambda axes: _ages(axes, report))
        yield _plot("steps", "Steps per second at the clients", lambda axes: _steps(axes, report))
    if server is not None:
        buckets = server["buckets"]
        yield _plot("lateness", "Lateness of steps, measured by the server",
                    lambda axes: _lateness(axes, buckets))  # fmt: skip
    if len(report.observed.samples) > 1:
        yield _plot("cores", "Processor time", lambda axes: _cores(axes, report))
        yield _plot("memory", "Memory of the server", lambda axes: _memory(axes, report))
    if returned.count:
        yield _plot("returns", "Connections that returned to their seats after the storm",
                    lambda axes: _returns(axes, returned))  # fmt: skip


def _plot(
    name: str, caption: str, draw: Callable[[Axes], None], size: tuple[float, float] = NARROW
) -> ReportFigure:
    return draw_figure(name, caption, size, lambda figure: draw(figure.add_subplot()), png=False)


def _spectra(report: LoadReport) -> ReportFigure:
    """Draw each distribution over the number of nines, as HdrHistogram does.

    A linear axis would hide the tail, which is what a player feels.
    """

    def draw(axes: Axes) -> None:
        least = lowest = 1.0
        for colour, name in zip(COLOURS, SPECTRA, strict=False):
            histogram = report.measured.duration(name)
            if not histogram.count:
                continue
            least = min(least, 1 / histogram.count)
            lowest = min(lowest, max(histogram.percentile(25) * 1000, 0.01))
            points = [(1 / max(1 - share, 1 / (2 * histogram.count)), seconds * 1000)
                      for share, seconds in histogram.spectrum()]  # fmt: skip
            axes.plot(*zip(*points, strict=True), color=colour, label=DURATIONS[name])
        ticks = {2: "50 %", 10: "90 %", 100: "99 %", 1000: "99.9 %", 10_000: "99.99 %",
                 100_000: "99.999 %"}  # fmt: skip
        shown = [tick for tick in ticks if tick <= 2 / least]
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks(shown, [ticks[tick] for tick in shown])
        axes.set_xticks([], minor=True)
        axes.set_xlim(left=1.25)
        axes.set_ylim(bottom=lowest / 2)
        axes.set_xlabel("percentile")
        axes.grid(visible=True, axis="x")
        _in_milliseconds(axes)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))

    return _plot("spectra", "Percentiles of durations", draw, WIDE)


def _in_milliseconds(axes: Axes) -> None:
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(lambda value, _: "")
    axes.set_ylabel("milliseconds")


def _ages(axes: Axes, report: LoadReport) -> None:
    rows = [row for row in report.series if "delta age" in row]
    times = [row["at"] for row in rows]
    for colour, (key, label) in zip(
        COLOURS, {"p50": "median", "p99": "p99", "max": "maximum"}.items(), strict=False
    ):
        values = [max(row["delta age"][key] * 1000, 0.001) for row in rows]
        axes.plot(times, values, color=colour, label=label)
    axes.set_yscale("log")
    _in_milliseconds(axes)
    _over_time(axes, report)
    legend_above(axes, 3)


def _steps(axes: Axes, report: LoadReport) -> None:
    # The first and last second are measured in part only, and their rates would mislead.
    whole = [row for row in report.series if row["seconds"] > 0.5]
    times = [row["at"] for row in whole]
    seen = [row["steps"] / row["seconds"] for row in whole]
    due = [row["steps due"] / row["seconds"] for row in whole]
    axes.plot(times, seen, color=COLOURS[0], label="received")
    axes.plot(times, due, color=COLOURS[1], linestyle=":", label="nominal")
    axes.set_ylim(bottom=0)
    axes.set_ylabel("steps per second")
    _over_time(axes, report)
    legend_above(axes, 2)


def _over_time(axes: Axes, report: LoadReport) -> None:
    """Label the time axis, shade the ramp and mark the storm."""
    observed = report.observed
    axes.set_xlabel("seconds since the measurement began")
    axes.axvspan(axes.get_xlim()[0], 0, color=SOFT, alpha=0.12, zorder=0, linewidth=0)
    axes.margins(x=0)
    if observed.storm_at is not None:
        at = observed.storm_at - observed.begun
        axes.axvline(at, color=RED, linewidth=1, linestyle="--")
        axes.annotate("storm", (at, 0.97), xycoords=("data", "axes fraction"), color=RED,
                      xytext=(4, 0), textcoords="offset points", va="top")  # fmt: skip


def _lateness(axes: Axes, buckets: dict[str, float]) -> None:
    limits = sorted((float(limit), count) for limit, count in buckets.items())
    total = limits[-1][1]
    labels, shares, below = [], [], 0.0
    for limit, count in limits:
        labels.append("more" if limit == inf else f"≤ {limit * 1000:g}")
        shares.append(100 * (count - below) / total)
        below = count
    bars = axes.bar(labels, shares, color=COLOURS[0], width=0.75)
    axes.bar_label(bars, [_percent(share) for share in shares], fontsize=7.5, padding=2)
    axes.tick_params(axis="x", labelsize=7.5)
    axes.set_xlabel("milliseconds late")
    axes.set_ylabel("% of steps")
    axes.margins(y=0.15)


def _percent(share: float) -> str:
    return "" if share == 0 else f"{share:.1f}" if share >= 0.1 else f"{share:.2g}"


def _cores(axes: Axes, report: LoadReport) -> None:
    base = report.observed.begun or report.observed.ended
    pairs = list(pairwise(report.observed.samples))
    times = [now.at - base for _, now in pairs]
    used = [(now.cpu - before.cpu) / max(now.at - before.at, 1e-3) for before, now in pairs]
    axes.plot(times, used, color=COLOURS[0], label="server")
    rows = report.series
    clients = [row["clients' cpu"] / max(row["seconds"], 1e-3) for row in rows]
    axes.plot([row["at"] for row in rows], clients, color=COLOURS[1], label="clients")
    axes.set_ylim(bottom=0)
    axes.set_ylabel("cores")
    _over_time(axes, report)
    legend_above(axes, 2)


def _memory(axes: Axes, report: LoadReport) -> None:
    base = report.observed.begun or report.observed.ended
    samples = report.observed.samples
    axes.plot([s.at - base for s in samples], [s.memory / 2**20 for s in samples], color=COLOURS[2])
    axes.set_ylim(bottom=0)
    axes.set_ylabel("MiB")
    _over_time(axes, report)


def _returns(axes: Axes, returned: Histogram) -> None:
    points = [(seconds, share * returned.count) for share, seconds in returned.spectrum()]
    times, counts = zip(*[(0.0, 0.0), *points], strict=True)
    axes.step(times, counts, where="post", color=COLOURS[0])
    axes.set_xlabel("seconds since the connections were cut")
    axes.set_ylabel("connections")
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
