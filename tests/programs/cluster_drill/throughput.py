"""Drill that measures the CPU time that nodes use per step, alone and as one of several.

On a machine with few cores, players and NATS servers compete with the nodes. So the drill does not
measure how many steps a cluster takes at most. It computes that from the CPU time per step.
"""

from __future__ import annotations

import asyncio
import os
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from tests.programs.cluster_drill.cluster import Cluster, Node, cpu_seconds, running_cluster
from tests.programs.cluster_drill.stage import WARM_UP_SECONDS, Plan, Result
from tests.programs.drill.crowd import Crowd

__all__ = ["run_throughput"]

WARM_SECONDS = 3.0
RATE = 5.0
SPARE_CORES = 1
"""Cores that players and NATS servers need for themselves."""


@dataclass(frozen=True, slots=True)
class Cost:
    """CPU time and steps of some processes during a measurement."""

    cpu: float
    steps: float

    @property
    def capacity(self) -> float:
        """Steps per second that one core can carry."""
        return self.steps / self.cpu if self.cpu else 0.0


async def run_throughput(plan: Plan, folder: Path, say: Callable[[str], None]) -> Result:
    """Measure one node with `plan.games` episodes, then several nodes with as many each."""
    result = Result()
    measure = partial(_measure, result=result, say=say)
    with _cores_of_nodes(plan.nodes) as cores:
        alone = await measure(replace(plan, nodes=1), folder / "one", cores)
        whole = replace(plan, games=plan.games * plan.nodes)
        together = await measure(whole, folder / "all", cores)
    one, several = alone[0].capacity, sum(cost.capacity for cost in together)
    how = "each node had a core" if cores else "nodes shared cores with other programs"
    result.rows += [
        ("method", f"realtime episodes of two players at {RATE:g} steps/s; {how}"),
        ("one node", f"{one:.0f} steps per CPU second, {one / RATE:.0f} episodes"),
        (f"{plan.nodes} nodes", f"{several:.0f} steps per second, {several / RATE:.0f} episodes"),
        ("ratio", f"{several / one:.2f}" if one else "unknown"),
    ]
    if not one or not several:
        result.faults.append("a node took no steps")
    return result


async def _measure(
    plan: Plan, folder: Path, cores: list[int], result: Result, say: Callable[[str], None]
) -> list[Cost]:
    evidence = folder / "told"
    evidence.mkdir(parents=True)
    async with running_cluster(folder, plan.nodes) as cluster:
        _pin(cluster.nodes, cores)
        crowd = Crowd(
            cluster.url, evidence, plan.seed, (100_000, 100_000), result.faults, mix="steady"
        )
        try:
            await crowd.start(plan.games, plan.processes, 0)
            await crowd.all_play(plan.games, WARM_UP_SECONDS)
            await asyncio.sleep(WARM_SECONDS)
            say(f"measuring {plan.nodes} nodes with {plan.games} episodes")
            costs, servers = await _costs(cluster, plan.away)
        finally:
            await crowd.stop()
        result.faults += cluster.faults
    steps = sum(cost.steps for cost in costs)
    result.rows += [
        (f"{plan.nodes} nodes: steps in {plan.away:g} s",
         ", ".join(f"{c.steps:.0f} in {c.cpu:.2f} s of CPU" for c in costs)
         + f"; expected {plan.games * RATE * plan.away:.0f} in all"),
        (f"{plan.nodes} nodes: NATS servers",
         f"{1000 * servers / steps if steps else 0:.2f} ms of CPU per step, all three together"),
    ]  # fmt: skip
    return costs


async def _costs(cluster: Cluster, seconds: float) -> tuple[list[Cost], float]:
    """Return the cost of each node, and the CPU time of the NATS servers."""
    before, servers = _counts(cluster), sum(map(cpu_seconds, cluster.nats.pids))
    await asyncio.sleep(seconds)
    costs = [
        Cost(then.cpu - now.cpu, then.steps - now.steps)
        for now, then in zip(before, _counts(cluster), strict=True)
    ]
    return costs, sum(map(cpu_seconds, cluster.nats.pids)) - servers


def _counts(cluster: Cluster) -> list[Cost]:
    return [Cost(cpu_seconds(n.process.pid), _steps(n)) for n in cluster.nodes]


def _steps(node: Node) -> float:
    """Return how many steps a node has taken."""
    address = node.url.replace("ws://", "http://") + "/metrics"
    with urllib.request.urlopen(address, timeout=10) as page:
        lines = page.read().decode().splitlines()
    return sum(float(line.split()[1]) for line in lines if line.startswith("robotouille_steps_t"))


def _pin(nodes: list[Node], cores: list[int]) -> None:
    """Give each node a core, with all its threads."""
    for node, core in zip(nodes, cores, strict=False):
        for thread in Path(f"/proc/{node.process.pid}/task").iterdir():
            os.sched_setaffinity(int(thread.name), {core})


@contextmanager
def _cores_of_nodes(nodes: int) -> Iterator[list[int]]:
    """Yield cores for the nodes, if there are enough, and keep all other programs off them."""
    cores = sorted(os.sched_getaffinity(0))
    own = cores[:nodes] if len(cores) >= nodes + SPARE_CORES else []
    os.sched_setaffinity(0, cores[len(own) :])
    try:
        yield own
    finally:
        os.sched_setaffinity(0, cores)
