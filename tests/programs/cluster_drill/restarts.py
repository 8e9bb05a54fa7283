"""Drills in which nodes start again: after a loss of power, and one after the other."""

from __future__ import annotations

import asyncio
import signal
import time
from statistics import median

from tests.programs.cluster_drill.cluster import CUT_OFF, core_wait
from tests.programs.cluster_drill.stage import Stage
from tests.programs.drill.report import spread

__all__ = ["power", "rolling"]

SETTLE_SECONDS = 2.0
QUIET_SECONDS = 10.0
LATE_SECONDS = 1.0


async def power(stage: Stage) -> None:
    """Kill all nodes and NATS servers, and start all of them again.

    The kernel survives, so this does not show what a disk loses without power.
    """
    stage.cluster.allow(*CUT_OFF)
    await stage.all_started()
    await stage.busiest()  # Waits until episodes are played.
    crowd, servers = stage.crowd, stage.cluster.nats
    crowd.mark()
    begun, players = time.monotonic(), set(crowd.playing)
    for index in range(len(servers.urls)):
        servers.kill(index)
    await stage.cluster.kill()
    stage.failed()
    crowd.mark()
    for index in range(len(servers.urls)):
        servers.start(index)
    await servers.ready()
    stage.row("loss of power → NATS ready", spread([time.monotonic() - begun]))
    await stage.cluster.start()
    started = time.monotonic()
    stage.row("loss of power → nodes joined", spread([started - begun]))
    # All nodes restore all episodes at the same time, so this takes longer than after one failure.
    await stage.act_again("nodes joined → players act again", players, started, bound=False)


async def rolling(stage: Stage) -> None:
    """Restart all nodes one after the other, several times."""
    crowd, plan = stage.crowd, stage.plan
    await stage.all_started()
    if plan.timed:
        begun = time.monotonic()
        await asyncio.sleep(QUIET_SECONDS)
        before = [late.seconds for late in crowd.late if late.at >= begun]
        stage.row(f"late steps in {QUIET_SECONDS:g} s before", spread(before))
    begun, waits = time.monotonic(), list[float]()
    for number in range(plan.rounds):
        for node in stage.cluster.nodes:
            episodes = len(stage.played_at(node))
            waits.append(core_wait(node.process.pid) / (time.monotonic() - node.process.started))
            await node.process.kill(signal.SIGTERM)
            took = node.process.stop_seconds[-1]
            await node.start()
            if plan.timed:
                await asyncio.sleep(SETTLE_SECONDS)
            stage.say(
                f"round {number + 1}, node {node.index}: {episodes} episodes handed over"
                f" in {took:.1f} s, {len(stage.played_at(node))} are new"
            )
    late = [one for one in crowd.late if one.at >= begun]
    seconds = [one.seconds for one in late]
    stops = [s for node in stage.cluster.nodes for s in node.process.stop_seconds]
    stage.row("SIGTERM → ended", spread(stops))
    stage.row(f"steps more than 0.5 s late in {time.monotonic() - begun:.0f} s", spread(seconds))
    shares = f"{100 * median(waits):.0f} % of their time, at most {100 * max(waits):.0f} %"
    stage.row("nodes without a core", shares)
    worst = [one for one in late if one.seconds >= LATE_SECONDS]
    if worst and plan.timed:
        text = ", ".join(f"{one.who} {one.seconds:.2f} s" for one in worst[:8])
        stage.fault(f"{len(worst)} steps were a second late: {text}")
