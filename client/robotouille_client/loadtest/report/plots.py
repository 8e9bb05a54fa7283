"""The report's plots, as SVG that can stand inside a page."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from io import StringIO
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

from robotouille_client.loadtest.histogram import Histogram
from robotouille_client.loadtest.report.report import DURATIONS, LoadReport

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Plot", "plots"]

INK, FAINT = "#334155", "#e2e8f0"
COLOURS = ("#2563eb", "#ea580c", "#059669", "#9333ea", "#64748b", "#db2777")
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9.5,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#94a3b8",
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.8,
    "lines.linewidth": 1.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
}
WIDE, NARROW = (12.6, 4.0), (6.2, 3.3)
"""Sizes in inches."""
SPECTRA = ("action, realtime", "action, lockstep", "action, turn", "delta age", "ping")


class Plot(NamedTuple):
    """A caption and an SVG; a wide one has a row for itself."""

    caption: str
    svg: str
    wide: bool = False


def plots(report: LoadReport) -> list[Plot]:
    """All plots for which there are figures."""
    import matplotlib

    drawn = []
    with matplotlib.rc_context(STYLE):
        for number, (caption, draw, possible) in enumerate(_wanted(report)):
            if possible:
                wide = number == 0
                drawn.append(Plot(caption, _svg(draw, number, WIDE if wide else NARROW), wide))
    return drawn


def _wanted(report: LoadReport) -> list[tuple[str, Callable[[Axes], None], bool]]:
    server = report.figures["steps"].get("by the server")
    returned = report.measured.duration("return")
    samples = len(report.observed.samples) > 1
    timed = any("delta age" in row for row in report.series)
    found = any(report.measured.duration(name).count for name in SPECTRA)
    return [
        ("Percentiles of durations", lambda axes: _spectra(axes, report), found),
        ("Age of deltas on arrival, second by second", lambda axes: _ages(axes, report), timed),
        ("Steps a second, seen by the clients", lambda axes: _steps(axes, report), timed),
        (
            "How late the server took its steps, by itself",
            lambda axes: _lateness(axes, server["buckets"] if server else {}),
            server is not None,
        ),
        ("Processor time of server and clients", lambda axes: _cores(axes, report), samples),
        ("Memory of the server", lambda axes: _memory(axes, report), samples),
        ("Back in their seats", lambda axes: _returns(axes, returned), returned.count > 0),
    ]


def _svg(draw: Callable[[Axes], None], number: int, size: tuple[float, float]) -> str:
    import matplotlib
    from matplotlib.figure import Figure

    matplotlib.rcParams["svg.hashsalt"] = f"plot {number}"
    figure = Figure(figsize=size, layout="constrained")
    draw(figure.add_subplot())
    output = StringIO()
    figure.savefig(output, format="svg", transparent=True, metadata={"Date": None})
    svg = output.getvalue()
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    # Ids are the document's, not the picture's.
    return re.sub(r'(id="|url\(#|href="#)', rf"\g<1>p{number}-", svg)


def _spectra(axes: Axes, report: LoadReport) -> None:
    """Each distribution over the number of nines, as HdrHistogram draws it."""
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
    ticks = [2, 10, 100, 1000, 10_000, 100_000]
    labels = ["50 %", "90 %", "99 %", "99.9 %", "99.99 %", "99.999 %"]
    shown = [(tick, label) for tick, label in zip(ticks, labels, strict=True) if tick <= 2 / least]
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks([t for t, _ in shown], [label for _, label in shown])
    axes.set_xticks([], minor=True)
    axes.set_xlim(left=1.25)
    axes.set_ylim(bottom=lowest / 2)
    axes.set_xlabel("so many are not above")
    _in_milliseconds(axes)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _in_milliseconds(axes: Axes) -> None:
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_ylabel("milliseconds")


def _ages(axes: Axes, report: LoadReport) -> None:
    rows = [row for row in report.series if "delta age" in row]
    times = [row["at"] for row in rows]
    for colour, key, label in zip(
        COLOURS, ("p50", "p99", "max"), ("median", "99 %", "largest"), strict=False
    ):
        values = [max(row["delta age"][key] * 1000, 0.001) for row in rows]
        axes.plot(times, values, color=colour, label=label)
    axes.set_yscale("log")
    _in_milliseconds(axes)
    _over_time(axes, report)
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, borderaxespad=0)


def _steps(axes: Axes, report: LoadReport) -> None:
    whole = [row for row in report.series if row["seconds"] > 0.5]
    times = [row["at"] for row in whole]
    axes.plot(times, [row["steps"] / row["seconds"] for row in whole], color=COLOURS[0],
              label="seen")  # fmt: skip
    axes.plot(times, [row["steps due"] / row["seconds"] for row in whole], color=COLOURS[1],
              linestyle=":", label="nominal")  # fmt: skip
    axes.set_ylim(bottom=0)
    axes.set_ylabel("steps a second")
    _over_time(axes, report)
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, borderaxespad=0)


def _over_time(axes: Axes, report: LoadReport) -> None:
    """Seconds since the measuring began; before that is the ramp."""
    observed = report.observed
    axes.set_xlabel("seconds")
    axes.axvspan(axes.get_xlim()[0], 0, color="#f1f5f9", zorder=0, linewidth=0)
    axes.margins(x=0)
    if observed.storm_at is not None:
        at = observed.storm_at - observed.begun
        axes.axvline(at, color="#dc2626", linewidth=1, linestyle="--")
        axes.annotate("storm", (at, 0.97), xycoords=("data", "axes fraction"), color="#dc2626",
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
    axes.bar_label(bars, [_percent(share) for share in shares], fontsize=8, padding=2)
    axes.set_xlabel("milliseconds late")
    axes.set_ylabel("% of the steps")
    axes.grid(visible=False, axis="x")
    axes.margins(y=0.15)


def _percent(share: float) -> str:
    return "" if share == 0 else f"{share:.1f}" if share >= 0.1 else f"{share:.2g}"


def _cores(axes: Axes, report: LoadReport) -> None:
    base = report.observed.begun or report.observed.ended
    samples = report.observed.samples
    pairs = list(pairwise(samples))
    times = [now.at - base for _, now in pairs]
    used = [(now.cpu - before.cpu) / max(now.at - before.at, 1e-3) for before, now in pairs]
    axes.plot(times, used, color=COLOURS[0], label="server")
    rows = report.series
    clients = [row["clients' cpu"] / max(row["seconds"], 1e-3) for row in rows]
    axes.plot([row["at"] for row in rows], clients, color=COLOURS[1], label="clients")
    axes.set_ylim(bottom=0)
    axes.set_ylabel("cores")
    _over_time(axes, report)
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, borderaxespad=0)


def _memory(axes: Axes, report: LoadReport) -> None:
    base = report.observed.begun or report.observed.ended
    samples: Sequence[Any] = report.observed.samples
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
