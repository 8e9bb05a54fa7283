"""Cost of spectators for the node that has their game. Run python -m tests.programs.fan_out.

Three NATS servers and three nodes run on this machine, with one game of two players in real time.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import tempfile
import urllib.request
from collections.abc import Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from typing import NamedTuple

from websockets import Subprotocol
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as open_socket

from robotouille.protocol.codec import MSGPACK
from robotouille_client import Client, connect
from tests.programs.cluster_drill.cluster import Cluster, Node, cpu_seconds, running_cluster

TASK = "training/03_multi_agent"
RATE = 10
SETTLE_SECONDS = 3.0
MANY = {
    "ROBOTOUILLE_MAX_SPECTATORS": "5000",
    "ROBOTOUILLE_MAX_CONNECTIONS_PER_ADDRESS": "10000",
    "ROBOTOUILLE_MESSAGES_PER_SECOND": "10000",
}


class Cost(NamedTuple):
    """CPU of the owner, and bytes to its clients and from all nodes to NATS."""

    cpu: float
    clients: float
    nats: float


async def spectator(node: Node, code: str, stack: AsyncExitStack) -> asyncio.Task[None]:
    """Watch a game, and read everything without decoding it."""
    socket = await stack.enter_async_context(
        open_socket(
            node.url, subprotocols=[Subprotocol(MSGPACK.name)], max_size=None, compression=None
        )
    )
    await socket.send(MSGPACK.pack({"type": "hello", "protocol": 1, "name": "eve"}))
    join = {"type": "join", "episode": code, "role": "spectator"}
    await socket.send(MSGPACK.pack(join))
    return asyncio.create_task(_read(socket))


async def _read(socket: ClientConnection) -> None:
    async for _ in socket:
        pass


def spent(cluster: Cluster, owner: Node) -> Cost:
    """Return the cost so far."""
    with urllib.request.urlopen(owner.url.replace("ws:", "http:") + "/metrics", timeout=10) as page:
        lines = page.read().decode().splitlines()
    sent = sum(
        float(line.split()[1]) for line in lines if line.startswith("robotouille_sent_bytes_total")
    )
    received = 0
    for i in range(len(cluster.nats.urls)):
        address = f"http://127.0.0.1:{cluster.nats._ports[i].monitor}/connz?limit=1000"
        with urllib.request.urlopen(address, timeout=10) as page:
            received += sum(each["in_bytes"] for each in json.load(page)["connections"])
    return Cost(cpu_seconds(owner.process.pid), sent, received)


async def cost(
    cluster: Cluster, owner: Node, code: str, places: Sequence[Node], seconds: float
) -> Cost:
    """Return the cost per second with a spectator at each place."""
    async with AsyncExitStack() as stack:
        reading = [await spectator(node, code, stack) for node in places]
        await asyncio.sleep(SETTLE_SECONDS)
        before = spent(cluster, owner)
        await asyncio.sleep(seconds)
        after = spent(cluster, owner)
        assert not any(task.done() for task in reading), "a spectator was disconnected"
        for task in reading:
            task.cancel()
    await asyncio.sleep(8)
    return Cost(*((b - a) / seconds for a, b in zip(before, after, strict=True)))


async def play(client: Client, code: str) -> None:
    game = await client.join(code)
    while not game.ended:
        await game.next_event()


async def measure(folder: Path, few: int, many: int, seconds: float) -> None:
    async with running_cluster(folder, 3) as cluster, AsyncExitStack() as stack:
        ada, bob = [
            await stack.enter_async_context(connect(cluster.nodes[0].url, name=name))
            for name in ("ada", "bob")
        ]
        created = await ada.create(TASK, seats=2, clock="realtime", step_rate=RATE, max_steps=10**5)
        games = [asyncio.create_task(play(client, created.code)) for client in (ada, bob)]
        await asyncio.sleep(SETTLE_SECONDS)
        owner = next(node for node in cluster.nodes if node.url == ada.url)
        others = [node for node in cluster.nodes if node is not owner]
        for count, where, nodes in (
            (0, "", others),
            (few, "on the owner", [owner]),
            (few, "on two other nodes", others),
            (many, "on two other nodes", others),
            (many, "on the owner", [owner]),
        ):
            places = [nodes[i % len(nodes)] for i in range(count)]
            found = await cost(cluster, owner, created.code, places, seconds)
            print(
                f"{count} spectators {where}: {1000 * found.cpu:.1f} ms of CPU a second, "
                f"{found.clients / 1000:.1f} kB/s to clients, {found.nats / 1000:.1f} kB/s to NATS",
                flush=True,
            )
        for task in games:
            task.cancel()


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.programs.fan_out", description=__doc__)
    parser.add_argument("--few", type=int, default=3, help="the smaller number of spectators")
    parser.add_argument("--many", type=int, default=600, help="the larger number of spectators")
    parser.add_argument("--seconds", type=float, default=20.0, help="seconds of each measurement")
    options = parser.parse_args()
    os.environ.update(MANY)
    with tempfile.TemporaryDirectory() as folder:
        asyncio.run(measure(Path(folder), options.few, options.many, options.seconds))


if __name__ == "__main__":
    main()
