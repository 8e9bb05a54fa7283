"""All drills by name, with their sizes."""

from __future__ import annotations

import asyncio
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
SHORT = Plan(games=3, away=4.0, rounds=1, processes=1, steps=(25, 50), timed=False)
SHORT_THROUGHPUT = Plan(games=4, away=4.0)
SIDE_BY_SIDE = (("stop", "partition", "rolling", "kill"), ("nats", "power"))
"""Short drills that share a cluster. Most of their time passes while NATS elects leaders, or nodes
wait for leases, so the clusters run at the same time."""

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
    """Run the short forms of drills on two clusters at the same time."""
    names, plan = list(names), adapt(SHORT)
    groups = [[name for name in group if name in names] for group in SIDE_BY_SIDE]
    results: dict[str, Result] = {}
    async with asyncio.TaskGroup() as running:
        tasks = {
            ", ".join(group): running.create_task(_together(group, plan, folder, say))
            for group in groups
            if group
        }
    for group, task in tasks.items():
        results |= task.result()
        results[f"{group}: comparison"] = results.pop("comparison")
    if THROUGHPUT in names:
        plan = adapt(SHORT_THROUGHPUT)
        results[THROUGHPUT] = await run_throughput(plan, folder / THROUGHPUT, say)
    return results


async def _together(names: list[str], plan: Plan, folder: Path, say: Say) -> dict[str, Result]:
    """Run drills one after the other on one cluster."""
    chosen = {name: DRILLS[name] for name in names}
    links = "partition" in chosen
    return await run_drills(plan, chosen, folder / "-".join(names), say, links=links)
