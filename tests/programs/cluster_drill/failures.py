"""Drills in which nodes and NATS servers fail."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from contextlib import AbstractAsyncContextManager
from pathlib import Path

from tests.programs.cluster_drill.cluster import CUT_OFF, NATS_SERVERS, Node
from tests.programs.cluster_drill.listeners import DELAYED, FAREWELLS, Listener, listening_to
from tests.programs.cluster_drill.stage import Stage
from tests.programs.drill.report import spread

__all__ = ["kill", "nats", "partition", "stop"]

TAKEOVER_SECONDS = 20.0
AFTER_SECONDS = 4.0
"""Longest time to observe a node that continues."""
LISTENERS = 10
WITHOUT_QUORUM = 5.0
JOURNALS = "robotouille_journal"


async def kill(stage: Stage) -> None:
    """Kill the busiest node, then start it again."""
    node = await stage.busiest()
    lost = stage.played_at(node)
    stage.row("episodes at the killed node", f"{len(lost)} of {len(stage.crowd.playing)} players")
    stage.crowd.mark()
    begun = time.monotonic()
    await node.process.kill(signal.SIGKILL)
    stage.failed()
    players, others = stage.players_of(lost), set(stage.crowd.playing)
    await stage.taken_over(lost, begun, TAKEOVER_SECONDS)
    await stage.act_again("kill → its players act again", players, begun)
    await stage.act_again("kill → other players act", others - players, begun)
    stage.restart(node)


async def stop(stage: Stage) -> None:
    """Stop the busiest node for a while, as a frozen virtual machine does."""
    stage.cluster.allow(*CUT_OFF)
    node = await stage.busiest()
    lost = stage.played_at(node)
    players = stage.players_of(lost)
    async with _listeners(stage, node, lost) as listeners:
        stage.crowd.mark()
        begun = time.monotonic()
        node.process.send(signal.SIGSTOP)
        await stage.taken_over(lost, begun, TAKEOVER_SECONDS)
        await asyncio.sleep(max(0.0, begun + stage.plan.away - time.monotonic()))
        acted = len(stage.crowd.acted.keys() & players)
        stage.row("its players who acted meanwhile", f"{acted} of {len(players)}")
        continued = time.monotonic()
        node.process.send(signal.SIGCONT)
        # An episode that had ended before is not taken over, and its node may still send.
        taken = stage.observer.taken_over_at(lost, begun)
        await _only_farewells(stage, listeners, dict.fromkeys(taken, continued))
    await stage.act_again("stop → its players act again", players, begun, bound=False)


async def partition(stage: Stage) -> None:
    """Cut the busiest node off from NATS, from its clients, and from both."""
    stage.cluster.allow(*CUT_OFF)
    for nats, clients in ((True, False), (False, True), (True, True)):
        await _partition(stage, nats, clients)


async def _partition(stage: Stage, nats: bool, clients: bool) -> None:
    node = await stage.busiest()
    lost = stage.played_at(node)
    players = stage.players_of(lost)
    links = (node.to_nats if nats else []) + (node.to_clients if clients else [])
    which = " and ".join(["NATS"] * nats + ["clients"] * clients)
    async with _listeners(stage, node, lost) as listeners:
        stage.row("cut off from", f"{which}: {len(lost)} episodes")
        stage.crowd.mark()
        begun = time.monotonic()
        for link in links:
            link.cut()
        if nats:
            await stage.taken_over(lost, begun, TAKEOVER_SECONDS)
        await asyncio.sleep(max(0.0, begun + stage.plan.away - time.monotonic()))
        acted = len(stage.crowd.acted.keys() & players)
        stage.row("its players who acted meanwhile", f"{acted} of {len(players)}")
        for link in links:
            link.heal()
        taken = stage.observer.taken_over_at(lost, begun)
        if nats and not clients:
            await _only_farewells(stage, listeners, taken)
        elif not nats:
            _none_moved(stage, list(taken))
    await stage.act_again("cut off → its players act again", players, begun, bound=False)


def _listeners(
    stage: Stage, node: Node, episodes: set[str]
) -> AbstractAsyncContextManager[list[Listener]]:
    records = [stage.observer.records[episode] for episode in sorted(episodes)[:LISTENERS]]
    codes = [(record.episode, record.code) for record in records]
    return listening_to(node.url, codes, Path(stage.evidence))


async def _only_farewells(stage: Stage, listeners: list[Listener], since: dict[str, float]) -> None:
    """Wait until a node has sent listeners away, and check what it sent since it lost episodes."""
    listeners = [listener for listener in listeners if listener.episode in since]
    leaving = (listener.ended.wait() for listener in listeners)
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(stage.limit(AFTER_SECONDS)):
            await asyncio.gather(*leaving)
    told = 0
    for listener in listeners:
        kinds = listener.after(since[listener.episode])
        told += len(kinds)
        if others := [kind for kind in kinds if kind not in (*FAREWELLS, *DELAYED)]:
            stage.fault(f"{listener.episode}: the node that had lost it has sent {others[:10]}")
    stage.row("messages to listeners since", f"{told} to {len(listeners)}, apart from violations")


async def nats(stage: Stage) -> None:
    """Kill one NATS server, the leader of the journals, and another one, and start them again."""
    stage.cluster.allow(*CUT_OFF)
    await stage.busiest()  # Waits until episodes are played.
    servers, crowd = stage.cluster.nats, stage.crowd
    before = {name: record.node for name, record in stage.observer.records.items()}
    first = servers.leader(JOURNALS)
    second = (first + 1) % NATS_SERVERS
    if stage.plan.timed:
        crowd.mark()
        begun = time.monotonic()
        servers.kill(second)
        await stage.act_again("follower killed → players act", set(crowd.playing), begun)
        servers.start(second)
        await servers.ready()
    crowd.mark()
    begun = time.monotonic()
    servers.kill(first)
    await stage.act_again("leader killed → players act", set(crowd.playing), begun)
    servers.kill(second)
    await _all_wait(stage)
    crowd.mark()
    begun, players = time.monotonic(), set(crowd.playing)
    servers.start(first)
    servers.start(second)
    await servers.ready()
    stage.row("NATS started → ready", spread([time.monotonic() - begun]))
    await stage.act_again("NATS started → players act", players, begun)
    if stage.plan.timed:
        await asyncio.sleep(AFTER_SECONDS)
    after = stage.observer.records
    _none_moved(stage, [n for n, node in before.items() if n in after and after[n].node != node])


def _none_moved(stage: Stage, moved: list[str]) -> None:
    """Check that no episode was taken over though all nodes lived."""
    if moved and stage.plan.timed:
        stage.fault(f"{len(moved)} episodes were taken over though all nodes lived: {moved}")
    elif moved:
        stage.row("episodes taken over from living nodes", f"{len(moved)}")


async def _all_wait(stage: Stage) -> None:
    """Wait until all episodes that had begun are paused because nothing can be stored."""
    deadline = time.monotonic() + stage.limit(WITHOUT_QUORUM)
    while True:
        begun = [row for row in await stage.crowd.report() if row["phase"] in ("running", "paused")]
        paused = [row for row in begun if "storage" in str(row["pause"])]
        if len(paused) == len(begun) or time.monotonic() > deadline:
            break
    stage.row("players who wait for storage", f"{len(paused)} of {len(begun)}")
    if len(paused) < len(begun) or not begun:
        others = [(row["who"], row["phase"], row["pause"]) for row in begun if row not in paused]
        stage.fault(f"{len(others)} of {len(begun)} players do not wait for storage: {others[:8]}")
