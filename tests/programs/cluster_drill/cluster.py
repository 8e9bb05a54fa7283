"""Nodes of a cluster and its NATS servers, as processes that drills kill, stop and start again."""

from __future__ import annotations

import asyncio
import io
import os
import signal
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager, redirect_stdout
from pathlib import Path

from tests.programs.drill.server import ServerProcess
from tests.support.nats import Link, NatsCluster, nats_cluster
from tests.support.worker_processes import lasting_ports

__all__ = [
    "CUT_OFF",
    "NATS_SERVERS",
    "Cluster",
    "Node",
    "core_wait",
    "cpu_seconds",
    "running_cluster",
]

READY_SECONDS = 120.0
STOP_SECONDS = 120.0
LOOK_SECONDS = 0.02
NATS_SERVERS = 3
JOINED = "joined the cluster"
TICKS = os.sysconf("SC_CLK_TCK")
CUT_OFF = (
    "recording failed",
    "connection to NATS lost",
    "the node's report was not stored",
    "the cluster's buckets cannot be used",
    "this node is cut off from NATS, and other nodes take its episodes over",
)
"""Errors in the log of a node that is cut off from NATS, or too slow for its leases."""


class Node:
    """One node: its consecutive processes, and its links to NATS and to its clients, if it has any.

    Attributes:
        url: The address for clients.
    """

    def __init__(self, folder: Path, nats: NatsCluster, links: ExitStack | None) -> None:
        folder.mkdir()
        self.index = int(folder.name.removeprefix("node"))
        self.recordings = folder / "recordings"
        self.faults: list[str] = []
        port = lasting_ports(1)
        self.url = f"ws://127.0.0.1:{port}"
        servers = nats.urls
        self.to_nats: list[Link] = []
        self.to_clients: list[Link] = []
        if links is not None:
            ports = [nats.port(i) for i in range(NATS_SERVERS)]
            self.to_nats = [links.enter_context(Link(port)) for port in ports]
            self.to_clients = [links.enter_context(Link(port))]
            servers = [link.url for link in self.to_nats]
            self.url = f"ws://127.0.0.1:{self.to_clients[0].port}"
        flags = ("--cluster", ",".join(servers), "--cluster-url", self.url, "--no-operator")
        self.process = ServerProcess(
            folder, port, self.faults, *flags, ready=JOINED, patience=STOP_SECONDS
        )

    async def start(self) -> None:
        """Start a process, and wait until it has joined the cluster."""
        process = self.process
        await process.start()
        deadline = time.monotonic() + READY_SECONDS
        while not process.listening.is_set():
            if process.ended or time.monotonic() > deadline:
                raise RuntimeError(f"a node does not join; see {process.folder}")
            await asyncio.sleep(LOOK_SECONDS)


class Cluster:
    """Three NATS servers and some nodes."""

    def __init__(self, folder: Path, nats: NatsCluster, nodes: list[Node]) -> None:
        self.folder = folder
        self.nats = nats
        self.nodes = nodes

    @property
    def url(self) -> str:
        """The addresses of all nodes, separated by commas."""
        return ",".join(node.url for node in self.nodes)

    @property
    def faults(self) -> list[str]:
        """Faults that the nodes' processes have shown."""
        return [f"node {node.index}: {fault}" for node in self.nodes for fault in node.faults]

    async def start(self) -> None:
        """Start all nodes."""
        await asyncio.gather(*(node.start() for node in self.nodes))

    async def kill(self, number: signal.Signals = signal.SIGKILL) -> None:
        """End the processes of all nodes at once."""
        await asyncio.gather(*(node.process.kill(number) for node in self.nodes))

    def allow(self, *entries: str) -> None:
        """Expect errors in the logs of all nodes, and no others."""
        for node in self.nodes:
            node.process.allowed = frozenset(entries)


@asynccontextmanager
async def running_cluster(
    folder: Path, nodes: int, *, links: bool = False, started: bool = True
) -> AsyncIterator[Cluster]:
    """Run NATS servers and nodes.

    Args:
        folder: An existing folder for stores, recordings and logs.
        nodes: The number of nodes.
        links: Let nodes reach NATS, and clients the nodes, through links that can be cut.
        started: Start the nodes. Otherwise the caller does that.
    """
    async with AsyncExitStack() as stack:
        nats = await stack.enter_async_context(_silent_nats(folder))
        lines = stack.enter_context(ExitStack()) if links else None
        cluster = Cluster(
            folder, nats, [Node(folder / f"node{i}", nats, lines) for i in range(nodes)]
        )
        try:
            if started:
                await cluster.start()
            yield cluster
        finally:
            await cluster.kill()


@asynccontextmanager
async def _silent_nats(folder: Path) -> AsyncIterator[NatsCluster]:
    """Run NATS servers whose logs remain in files."""
    running = nats_cluster(folder / "nats", NATS_SERVERS)
    nats = await asyncio.to_thread(running.__enter__)
    try:
        yield nats
    finally:
        with redirect_stdout(io.StringIO()):  # It prints the logs of its servers.
            running.__exit__(None, None, None)


def core_wait(pid: int) -> float:
    """Return the seconds in which a process could have run, but other programs had all cores."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9


def cpu_seconds(pid: int) -> float:
    """Return the CPU time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS
