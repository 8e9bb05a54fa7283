"""Watches of buckets on a real NATS server."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest
from nats.js import JetStreamContext

from robotouille.errors import RobotouilleError
from robotouille.nats.address import NatsAddress
from robotouille_server.cluster.bus import Append, Bucket, BusError, Entry, UnavailableError
from robotouille_server.cluster.nats.nats_bus import NatsBus, nats_bus
from tests.support.lying_nats import MIB, endless, lying_nats
from tests.support.nats import missing, nats_cluster

pytestmark = [
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(bool(missing()), reason=missing()),
]

PATIENCE = 60


def noting(changes: list[str]) -> Callable[[str, Entry | None], None]:
    return lambda key, entry: changes.append(key)


async def put(bus: NatsBus, key: str, changes: list[str]) -> None:
    """Set a key, and wait until a watch reports it."""
    await bus.put(Bucket.NODES, key, b"report")
    async with asyncio.timeout(PATIENCE):
        while key not in changes:
            await asyncio.sleep(0.01)
    # A second watch would report the key at about the same time.
    await asyncio.sleep(0.2)


async def test_watch_of_a_bucket_replaces_an_earlier_one(tmp_path: Path) -> None:
    with nats_cluster(tmp_path, servers=1) as cluster:
        async with nats_bus(NatsAddress(tuple(cluster.urls), "robotouille")) as bus:
            first, second = list[str](), list[str]()
            await bus.watch(Bucket.NODES, noting(first))
            await put(bus, "a", first)
            await bus.watch(Bucket.NODES, noting(second))
            assert second == ["a"], "existing keys are reported again"
            await put(bus, "b", second)
            assert first == ["a"]
            assert second == ["a", "b"]


async def test_journals_are_listed_until_they_are_deleted(tmp_path: Path) -> None:
    with nats_cluster(tmp_path, servers=1) as cluster:
        address = tuple(cluster.urls)
        async with (
            nats_bus(NatsAddress(address, "robotouille")) as bus,
            nats_bus(NatsAddress(address, "other")) as other,
        ):
            assert await bus.journals() == []
            for each, name in ((bus, "a1"), (bus, "b2"), (other, "c3")):
                stored: asyncio.Future[int | BusError] = asyncio.Future()
                each.append(Append(name, b"header", 0, name), stored.set_result)
                assert isinstance(await stored, int)
            assert sorted(await bus.journals()) == ["a1", "b2"]
            await bus.purge("a1")
            assert await bus.journals() == ["b2"]


async def append(bus: NatsBus, journal: str, number: int, after: int) -> int:
    stored: asyncio.Future[int | BusError] = asyncio.Future()
    bus.append(Append(journal, b"note", after, f"{journal}.{number}"), stored.set_result)
    sequence = await stored
    assert isinstance(sequence, int)
    return sequence


async def test_games_write_while_a_long_journal_is_read(tmp_path: Path) -> None:
    with nats_cluster(tmp_path, servers=1) as cluster:
        async with nats_bus(NatsAddress(tuple(cluster.urls), "robotouille")) as bus:
            last = 0
            for number in range(2000):
                last = await append(bus, "long", number, last)
            reading = asyncio.create_task(bus.read("long"))
            written = last = 0
            while not reading.done():
                last = await append(bus, "game", written, last)
                written += 1
            assert len(reading.result()) == 2000
            assert [message.id for message in reading.result()[:2]] == ["long.0", "long.1"]
            assert len(await bus.read("long", reading.result()[499].sequence)) == 1500
            # Otherwise, the answers to the writes would come after the whole journal.
            assert written > 15


async def test_attempt_to_watch_that_fails_leaves_only_the_earlier_watch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def unanswered(watching: JetStreamContext.PushSubscription) -> None:
        raise TimeoutError

    with nats_cluster(tmp_path, servers=1) as cluster:
        async with nats_bus(NatsAddress(tuple(cluster.urls), "robotouille")) as bus:
            first, second = list[str](), list[str]()
            await bus.watch(Bucket.NODES, noting(first))
            monkeypatch.setattr(JetStreamContext.PushSubscription, "consumer_info", unanswered)
            with pytest.raises(UnavailableError):
                await bus.watch(Bucket.NODES, noting(second))
            await put(bus, "a", first)
            assert second == []


def test_message_without_end_does_not_fill_the_memory() -> None:
    async def begin(url: str) -> None:
        async with nats_bus(NatsAddress((url,), "robotouille")):
            pass

    with lying_nats({"STREAM.CREATE": endless}) as (url, liar):
        with pytest.raises(RobotouilleError, match="--cluster: JetStream is not ready"):
            asyncio.run(begin(url))
    assert liar.sent < 100 * MIB
