"""All drills by name, with their sizes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from tests.programs.cluster_drill.failures import kill, nats, partition, stop
from tests.programs.cluster_drill.restarts import power, rolling
from tests.programs.cluster_drill.stage import Drill, Plan, Result, run_drills
from tests.programs.cluster_drill.throughput import run_throughput

__all__ = ["DRILLS", "SHORT", "THROUGHPUT", "run", "run_short"]

DRILLS: dict[str, Drill] = {
    "kill": kill,
    "stop": stop,
    "partition": partition,
    "nats": nats,
    "rolling": rolling,
    "power": power,
}
THROUGHPUT = "throughput"
LONG = {
    "rolling": Plan(games=300, mix="steady"),
    THROUGHPUT: Plan(games=30),
}
SHORT = Plan(games=10, away=6.0, rounds=2, steps=(40, 120), patience=60.0, timed=False)
SHORT_THROUGHPUT = Plan(games=4, away=4.0)

Adapt = Callable[[Plan], Plan]
Say = Callable[[str], None]


def _same(plan: Plan) -> Plan:
    return plan


async def run(
    names: Iterable[str], folder: Path, say: Say, adapt: Adapt = _same
) -> dict[str, Result]:
    """Run the long forms of drills, each on its own cluster."""
    results: dict[str, Result] = {}
    for name in names:
        plan = adapt(LONG.get(name, Plan()))
        if name == THROUGHPUT:
            results[name] = await run_throughput(plan, folder / name, say)
            continue
        links = name == "partition"
        done = await run_drills(plan, {name: DRILLS[name]}, folder / name, say, links=links)
        results[name] = done[name]
        results[f"{name}: comparison"] = done["comparison"]
    return results


async def run_short(
    names: Iterable[str], folder: Path, say: Say, adapt: Adapt = _same
) -> dict[str, Result]:
    """Run the short forms of drills, one after the other on one cluster."""
    names = list(names)
    chosen = {name: DRILLS[name] for name in names if name in DRILLS}
    results: dict[str, Result] = {}
    if chosen:
        links = "partition" in chosen
        results = await run_drills(adapt(SHORT), chosen, folder / "drills", say, links=links)
    if THROUGHPUT in names:
        plan = adapt(SHORT_THROUGHPUT)
        results[THROUGHPUT] = await run_throughput(plan, folder / THROUGHPUT, say)
    return results
