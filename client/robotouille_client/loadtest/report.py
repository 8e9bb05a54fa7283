"""Results of a load test as plain values, for the summary, the JSON file and the HTML page."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from robotouille.installation import RELEASE
from robotouille_client.loadtest.histogram import Histogram, Measurements
from robotouille_client.loadtest.load_test import LoadObservation, LoadTest, refusals
from robotouille_client.loadtest.server_monitor import DELTA_AGE, LATENESS, Buckets, ServerSample
from robotouille_client.loadtest.workload import LoadPlan

PERCENTILES = (50.0, 90.0, 99.0, 99.9, 99.99)
LATE = (0.005, 0.02, 0.05, 0.1)
"""Limits in seconds. The report gives the share of steps that are less late than each."""
LAG_LIMIT, BUSY_LIMIT = 0.005, 0.85
"""Lag in seconds and use of a core above which the clients distort what they measure."""

DURATIONS = {
    "action, realtime": "action to delta, real time, without the wait for the step",
    "action with its wait, realtime": "action to delta, real time, with the wait",
    "action, lockstep": "action to delta, lockstep",
    "action, turn": "action to delta, turn clock",
    "delta age": "age of deltas on arrival, from the time their step was due",
    "ping": "ping through the server's event loop",
    "return": "return to the seat after the storm",
    "client lag": "lag of the load tester's own event loops",
    "opening": "connecting, joining and starting",
}
"""Keys of the measured durations, with their titles."""


@dataclass(frozen=True)
class LoadReport:
    """Figures by section, and notes on their validity. Times are in seconds, sizes in bytes."""

    plan: LoadPlan
    observed: LoadObservation
    measured: Measurements
    figures: dict[str, Any]
    series: list[dict[str, Any]]
    notes: list[str]

    def to_json(self) -> dict[str, Any]:
        return {
            "plan": self.plan.model_dump(mode="json"),
            "figures": self.figures,
            "notes": self.notes,
            "series": self.series,
            "histograms": {
                name: histogram.spectrum() for name, histogram in self.measured.durations.items()
            },
        }


def make_report(load_test: LoadTest) -> LoadReport:
    """Return the report of a load test that has finished or was interrupted."""
    plan, observed, pool = load_test.plan, load_test.observed, load_test.pool
    measured = Measurements()
    measured.merge(pool.totals)
    if "opening" not in measured.durations and "opening" in pool.ramp.durations:
        measured.durations["opening"] = pool.ramp.durations["opening"]
    seconds = max(0.0, observed.ended - observed.begun) if observed.begun else 0.0
    figures: dict[str, Any] = {
        "when": datetime.now(UTC).isoformat(timespec="seconds"),
        "tester": RELEASE,
        "server": observed.server,
        "machine": _machine(),
        "seconds": seconds,
        "interrupted": observed.interrupted,
        "rooms playing": sum(pool.playing),
        "connections": sum(pool.connected),
        "durations": {name: _summary(h) for name, h in sorted(measured.durations.items())},
        "steps": _steps(measured, observed),
        "traffic": _traffic(measured, seconds),
        "counts": _counts(measured, pool.ramp),
        "server process": _process(observed),
        "storm": _storm(plan, observed, measured, pool.storm_cut),
        "clients": _clients(load_test),
    }
    series = _series(load_test)
    return LoadReport(plan, observed, measured, figures, series, _notes(load_test, figures))


def _machine() -> dict[str, Any]:
    return {
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.release()}",
        "processor": platform.processor() or platform.machine(),
        "python": platform.python_version(),
    }


def _summary(histogram: Histogram) -> dict[str, float]:
    percentiles = {f"p{p:g}": histogram.percentile(p) for p in PERCENTILES}
    return {
        "count": histogram.count, "mean": histogram.mean, **percentiles, "max": histogram.largest,
    }  # fmt: skip


def _steps(measured: Measurements, observed: LoadObservation) -> dict[str, Any]:
    age = measured.duration("delta age")
    due, seen = measured.counts.get("steps due", 0.0), measured.counts.get("steps", 0.0)
    steps: dict[str, Any] = {
        "due": due,
        "seen": seen,
        "rate held": seen / due if due else None,
        "seen within": {f"{limit:g}": age.share_within(limit) for limit in LATE},
    }
    for title, name in (("by the server", LATENESS), ("age when sent", DELTA_AGE)):
        buckets = _of_the_server(observed, name)
        if buckets is not None:
            steps[title] = {
                "count": buckets.count,
                "within": {f"{limit:g}": buckets.share_within(limit) for limit in LATE},
                **{f"p{p:g}": buckets.percentile(p) for p in PERCENTILES},
                "buckets": {f"{le:g}": n for le, n in sorted(buckets.within.items())},
            }
    return steps


def _of_the_server(observed: LoadObservation, name: str) -> Buckets | None:
    """Return one of the server's own histograms, limited to the measured time."""
    if observed.before is None or observed.after is None:
        return None
    buckets = observed.after.since(observed.before).histograms.get(name)
    return buckets if buckets is not None and buckets.count > 0 else None


def _traffic(measured: Measurements, seconds: float) -> dict[str, float]:
    counts = measured.counts
    names = ("messages in", "messages out", "bytes in", "bytes out")
    return {
        **{name: counts.get(name, 0.0) for name in names},
        **{f"{name} a second": counts.get(name, 0.0) / seconds for name in names if seconds},
    }


def _counts(measured: Measurements, ramp: Measurements) -> dict[str, float]:
    """Return all other counts. Refusals during the ramp are included."""
    shown = ("bytes ", "messages ", "steps")
    counts = {name: n for name, n in measured.counts.items() if not name.startswith(shown)}
    for name, n in ramp.counts.items():
        if name.startswith(("not begun", "refused", "rejected")):
            counts[name] = counts.get(name, 0.0) + n
    return dict(sorted(counts.items()))


def _process(observed: LoadObservation) -> dict[str, Any] | None:
    inside = _inside(observed)
    if len(inside) < 2:
        return None
    first, last = inside[0], inside[-1]
    passed = last.at - first.at
    memory = observed.memory
    figures: dict[str, Any] = {
        "cores used": (last.cpu - first.cpu) / passed,
        "memory": last.memory,
        "most memory": max(sample.memory for sample in observed.samples),
        "memory at": memory,
        "cores used by all processes": (last.busy - first.busy) / passed,
    }
    return figures


def _inside(observed: LoadObservation) -> list[ServerSample]:
    """Return the samples taken during the measured time."""
    if not observed.begun:
        return []
    return [s for s in observed.samples if observed.begun <= s.at <= observed.ended]


def memory_each(plan: LoadPlan, memory: dict[str, int]) -> float | None:
    """Return the bytes of server memory for each idle spectator, or None if not measured."""
    if not plan.spectators or "spectators" not in memory or "rooms" not in memory:
        return None
    return (memory["spectators"] - memory["rooms"]) / plan.spectators


def _storm(
    plan: LoadPlan, observed: LoadObservation, measured: Measurements, cut: int
) -> dict[str, Any] | None:
    if observed.storm_at is None:
        return None
    back = measured.duration("return")
    return {
        "asked": plan.storm,
        "cut": cut,
        "back": back.count,
        "over after": back.largest if back.count >= cut else None,
        "failed attempts": measured.counts.get("failed attempts to return", 0.0),
    }


def _clients(load_test: LoadTest) -> dict[str, float]:
    """Return the cores used by the busiest process of the load tester and by all of them."""
    seconds = [second for second in load_test.pool.seconds.values() if second.measured]
    count = max(1, len(seconds))
    return {
        "busiest process, of a core": sum(second.busiest for second in seconds) / count,
        "cores used": sum(second.cpu for second in seconds) / count,
    }


def _series(load_test: LoadTest) -> list[dict[str, Any]]:
    """Return one row for each second, with its time since the measurement began."""
    base = load_test.observed.begun or load_test.observed.ended
    rows = []
    for at, second in sorted(load_test.pool.seconds.items()):
        row: dict[str, Any] = {
            "at": at - base,
            "measured": second.measured,
            "connected": second.connected,
            "playing": second.playing,
            "seconds": second.seconds,
            "steps": second.all.counts.get("steps", 0.0),
            "steps due": second.all.counts.get("steps due", 0.0),
            "clients' cpu": second.cpu,
        }
        for name in DURATIONS:
            if histogram := second.all.durations.get(name):
                row[name] = {
                    "p50": histogram.percentile(50),
                    "p99": histogram.percentile(99),
                    "max": histogram.largest,
                }
        rows.append(row)
    return rows


def _notes(load_test: LoadTest, figures: dict[str, Any]) -> list[str]:
    """Return the warnings that a reader needs before using the figures."""
    notes = []
    plan, observed = load_test.plan, load_test.observed
    if observed.interrupted:
        notes.append("Interrupted: the figures cover the time until then.")
    lag = load_test.pool.totals.duration("client lag").percentile(99)
    busy = figures["clients"]["busiest process, of a core"]
    if lag > LAG_LIMIT or busy > BUSY_LIMIT:
        notes.append(
            f"The clients themselves were slow: their event loops lagged by {lag * 1000:.1f} ms "
            f"(p99) and used {busy:.0%} of a core. Durations measured by the clients include this "
            "lag; the server's own figures do not. Try more --processes or other --cpus."
        )
    if plan.rooms and figures["rooms playing"] < plan.rooms:
        missing = plan.rooms - figures["rooms playing"]
        reasons = refusals(load_test.pool.ramp.counts)
        notes.append(f"{missing:,} of {plan.rooms:,} rooms did not play. " + " ".join(reasons))
    if load_test.process is None:
        notes.append(
            "CPU and memory of the server were not measured: its process was not found on this "
            "machine. Set it with --pid."
        )
    if observed.begun and "by the server" not in figures["steps"] and figures["steps"]["due"]:
        notes.append(
            "The server's own lateness is missing because no metrics were found. Set --metrics."
        )
    notes += _busy_machine(figures)
    return notes


def _busy_machine(figures: dict[str, Any]) -> list[str]:
    """Return a warning if other programs took so much time that the figures mean little."""
    process, cores = figures["server process"], os.cpu_count() or 1
    if process is None:
        return []
    used = process["cores used by all processes"]
    others = used - process["cores used"] - figures["clients"]["cores used"]
    if others < 0.25 or used < 0.9 * cores:
        return []
    return [
        f"Other programs used {others:.1f} of this machine's {cores} cores, so the server and the "
        "clients had to wait."
    ]
