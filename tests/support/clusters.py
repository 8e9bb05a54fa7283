"""Clusters in one process: real servers and clients, a simulated NATS and virtual time."""

from __future__ import annotations

import random
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from robotouille_server import Server, ServerSettings, serve
from robotouille_server.app import Surroundings
from robotouille_server.cluster.joining import Cluster, joined_through
from robotouille_server.rooms.substitutes.bot_worker import ThreadBotWorker
from tests.support.buses import SimulatedBus, SimulatedNats
from tests.support.executors import ImmediateExecutor
from tests.support.servers import STAMP, crash

__all__ = ["Node", "Nodes", "cluster_of", "cluster_on"]


@dataclass(slots=True)
class Node:
    """One node, with its folder of recordings."""

    server: Server
    cluster: Cluster
    bus: SimulatedBus
    folder: Path
    killed: bool = False

    @property
    def url(self) -> str:
        return self.server.url

    @property
    def rooms(self) -> set[str]:
        """Ids of its episodes that have not ended."""
        if self.killed:
            return set()
        rooms = self.server.lobby.rooms.values()
        return {room.id for room in rooms if not room.episode.ended}

    async def kill(self) -> None:
        """Stop the node like `kill -9`."""
        self.killed = True
        self.bus.cut()
        await crash(self.server)

    async def leave(self) -> None:
        """Stop the node like SIGTERM."""
        await self.cluster.node.leave()
        await self.server.drain(0.0)
        await self.server.stop("the server is restarted", hand_over=True)


@dataclass(slots=True)
class Nodes:
    """All nodes of a cluster."""

    nats: SimulatedNats
    nodes: list[Node] = field(default_factory=list)

    def __getitem__(self, i: int) -> Node:
        return self.nodes[i]

    def __iter__(self) -> Any:
        return iter(self.nodes)

    def owner(self, episode: str) -> Node:
        """Return the only node that has an episode."""
        (owner,) = (node for node in self.nodes if episode in node.rooms)
        return owner

    def others(self, node: Node) -> list[Node]:
        return [other for other in self.nodes if other is not node]


@asynccontextmanager
async def cluster_of(folder: Path, nodes: int = 3, **options: Any) -> AsyncIterator[Nodes]:
    """Run some nodes. Call this in virtual time."""
    async with cluster_on(SimulatedNats(random.Random(1)), folder, nodes, **options) as found:
        yield found


@asynccontextmanager
async def cluster_on(
    nats: SimulatedNats,
    folder: Path,
    nodes: int,
    *,
    each: Sequence[Mapping[str, Any]] = (),
    clocks: Sequence[float] = (),
    seed: int = 0,
    **options: Any,
) -> AsyncIterator[Nodes]:
    """Run some nodes on a service that exists. Call this in virtual time.

    Args:
        nats: The service.
        folder: The folder for the nodes' recordings.
        nodes: The number of nodes.
        each: Options of each node that differ from those of the others.
        clocks: The seconds by which the clock of each node is fast.
        seed: The seed of the first node; the others have the next ones. Nodes with equal seeds have
            equal names.
        options: Options of all nodes.
    """
    found = Nodes(nats)
    async with AsyncExitStack() as stack:
        for i in range(nodes):
            own = folder / f"node{i}"
            values = {"countdown": 0.0, "port": 0, "recordings": own, **options}
            settings = ServerSettings(**{**values, **(each[i] if each else {})})
            around = Surroundings(
                randomness=random.Random(seed + i),
                timestamp=lambda: STAMP,
                wall=partial(_clock, clocks[i] if clocks else 0.0),
                bot_worker=lambda: ThreadBotWorker(ImmediateExecutor()),
            )
            bus = found.nats.bus(f"node{i}")
            cluster = await stack.enter_async_context(joined_through(bus, settings, around))
            server = await stack.enter_async_context(serve(settings, cluster.around))
            await stack.enter_async_context(cluster.serving(server))
            found.nodes.append(Node(server, cluster, bus, own))
        yield found


def _clock(fast: float) -> float:
    return time.time() + fast
