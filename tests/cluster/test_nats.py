"""NATS servers of the tests: a stream survives its leader, and links can be cut."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import nats
import pytest
from nats.aio.client import Client
from nats.aio.msg import Msg
from nats.errors import Error
from nats.js import JetStreamContext

from tests.support.nats import Link, missing, nats_cluster

pytestmark = [
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(bool(missing()), reason=missing()),
]

PATIENCE = 60


@asynccontextmanager
async def connected(*urls: str, **options: Any) -> AsyncIterator[Client]:
    options |= {"reconnect_time_wait": 0.05, "max_reconnect_attempts": -1}
    client = await nats.connect(list(urls), **options)
    try:
        yield client
    finally:
        await client.close()


async def publish(stream: JetStreamContext, text: bytes) -> int:
    """Publish until a quorum has stored the message, and return its number."""
    async with asyncio.timeout(PATIENCE):
        while True:
            try:
                return (await stream.publish("moves", text, timeout=1)).seq
            except (Error, OSError):
                await asyncio.sleep(0.05)


async def echo(client: Client) -> asyncio.Queue[bytes]:
    """Return a queue that receives what is published on the subject `echo`."""
    received: asyncio.Queue[bytes] = asyncio.Queue()

    async def receive(message: Msg) -> None:
        received.put_nowait(message.data)

    await client.subscribe("echo", cb=receive)
    await client.flush()
    return received


async def silence(client: Client, received: asyncio.Queue[bytes]) -> None:
    """Publish a message, which must not arrive."""
    await client.publish("echo", b"one")
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(received.get(), 0.3)


async def sound(received: asyncio.Queue[bytes]) -> None:
    """Wait for the message."""
    assert await asyncio.wait_for(received.get(), PATIENCE) == b"one"


async def test_stream_survives_its_leader(tmp_path: Path) -> None:
    with nats_cluster(tmp_path) as cluster:
        async with connected(*cluster.urls) as client:
            stream = client.jetstream()
            await stream.add_stream(name="log", subjects=["moves"], num_replicas=3)
            assert await publish(stream, b"one") == 1
            before = (await stream.stream_info("log")).cluster
            assert before is not None and before.leader is not None
            cluster.kill(cluster.index(before.leader))
            assert await publish(stream, b"two") >= 2
            assert (await stream.get_msg("log", 1)).data == b"one"
            cluster.start(cluster.index(before.leader))
            await cluster.ready()


async def test_single_server_keeps_its_stream(tmp_path: Path) -> None:
    with nats_cluster(tmp_path, servers=1) as cluster:
        async with connected(*cluster.urls) as client:
            stream = client.jetstream()
            await stream.add_stream(name="log", subjects=["moves"])
            assert await publish(stream, b"one") == 1
            cluster.kill(0)
            cluster.start(0)
            assert await publish(stream, b"two") == 2


async def test_stopped_server_answers_after_it_continues(tmp_path: Path) -> None:
    with nats_cluster(tmp_path, servers=1) as cluster:
        async with connected(*cluster.urls) as client:
            received = await echo(client)
            cluster.stop(0)
            await silence(client, received)
            cluster.cont(0)
            await sound(received)


async def test_link_is_silent_while_cut(tmp_path: Path) -> None:
    with nats_cluster(tmp_path, servers=1) as cluster, Link(cluster.port(0)) as link:
        async with connected(link.url) as client:
            received = await echo(client)
            link.cut()
            await silence(client, received)
            assert client.is_connected
            link.heal()
            await sound(received)


@pytest.mark.parametrize("up", [False, True])
async def test_link_is_cut_in_one_direction(tmp_path: Path, up: bool) -> None:
    with nats_cluster(tmp_path, servers=1) as cluster, Link(cluster.port(0)) as link:
        async with connected(link.url) as client, connected(*cluster.urls) as other:
            received, heard = await echo(client), await echo(other)
            link.cut(up=up, down=not up)
            await silence(client, received)
            if up:
                assert heard.empty()
                link.heal()
            await sound(heard)
            link.heal()
            await sound(received)


async def test_closed_link_refuses_connections(tmp_path: Path) -> None:
    again = asyncio.Event()

    async def reconnected() -> None:
        again.set()

    with nats_cluster(tmp_path, servers=1) as cluster, Link(cluster.port(0)) as link:
        async with connected(link.url, reconnected_cb=reconnected) as client:
            received = await echo(client)
            link.close()
            with pytest.raises(ConnectionRefusedError):
                await asyncio.open_connection("127.0.0.1", link.port)
            link.heal()
            await asyncio.wait_for(again.wait(), PATIENCE)
            await client.publish("echo", b"one")
            await sound(received)
