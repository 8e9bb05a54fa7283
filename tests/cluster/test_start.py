"""Nodes that start at once with NATS servers on which nothing exists yet."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from robotouille_server.cluster.bus import Bucket
from robotouille_server.cluster.nats.nats_bus import NatsAddress, nats_bus
from tests.support.nats import missing, nats_cluster

NODES = 6


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.skipif(bool(missing()), reason=missing())
async def test_nodes_that_start_at_once_can_use_all_buckets(tmp_path: Path) -> None:
    with nats_cluster(tmp_path) as cluster:
        address = NatsAddress(tuple(cluster.urls), "robotouille")
        async with AsyncExitStack() as stack:

            async def start() -> None:
                bus = await stack.enter_async_context(nats_bus(address))
                for bucket in Bucket:
                    assert await bus.get(bucket, "unknown") is None
                assert await bus.last("unknown") is None

            await asyncio.gather(*(start() for _ in range(NODES)))
