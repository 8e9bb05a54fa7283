"""Journals that survive the deletion of another one when all NATS servers start again."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille_server.cluster.bus import Append, BusError, UnavailableError
from robotouille_server.cluster.nats.nats_bus import NatsAddress, NatsBus, nats_bus
from tests.support.nats import missing, nats_cluster

MESSAGES = 5


async def append(bus: NatsBus, journal: str, expected: int) -> int:
    done: asyncio.Future[int | BusError] = asyncio.get_running_loop().create_future()
    message = Append(journal, b"step", expected, f"{journal}.{expected}")
    bus.append(message, done.set_result)
    result = await done
    assert isinstance(result, int), result
    return result


async def count(bus: NatsBus, journal: str) -> int:
    """Return the number of messages in a journal, once NATS answers."""
    while True:
        try:
            return len(await bus.read(journal))
        except UnavailableError:
            await asyncio.sleep(0.1)


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.skipif(bool(missing()), reason=missing())
async def test_journals_survive_a_restart_after_another_was_deleted(tmp_path: Path) -> None:
    with nats_cluster(tmp_path) as cluster:
        async with nats_bus(NatsAddress(tuple(cluster.urls), "robotouille")) as bus:
            last = {"kept": 0, "over": 0}
            for _ in range(MESSAGES):
                last = {name: await append(bus, name, at) for name, at in last.items()}
            await bus.store("recording.rbt", b"first")
            await bus.store("recording.rbt", b"second")
            await bus.store("other.rbt", b"other")
            await bus.purge("over")
            assert await count(bus, "over") == 0
            await append(bus, "kept", last["kept"])
            for each in range(3):
                cluster.kill(each)
            for each in range(3):
                cluster.start(each)
            await cluster.ready()
            assert await count(bus, "kept") == MESSAGES + 1
            assert await count(bus, "over") == 0
            files = await bus._js.object_store("robotouille_recordings")
            assert (await files.get("recording.rbt")).data == b"second"
            assert (await files.get("other.rbt")).data == b"other"
            # Another program may write into a journal.
            foreign = {"Robotouille-Keep": "abc"}
            await bus._js.publish("robotouille.journal.kept", b"junk", headers=foreign)
            assert (await bus.last("kept")) == (await bus.read("kept"))[-1]
