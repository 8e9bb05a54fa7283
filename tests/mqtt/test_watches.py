"""What laboratories watch, and for how long: in virtual time."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

from robotouille_client import connect
from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.mqtt.watches import MAX_WATCHES
from tests.support.brokers import FakeBroker, Lab, role_token, told
from tests.support.virtual_time import run

NAME = "robotouille/v1/lab"


def watch(server: Server, broker: FakeBroker, **what: Any) -> None:
    broker.command({"type": "watch", "ref": "w", "token": role_token(server), **what})


def test_a_watch_of_labels_is_for_episodes_to_come_and_ends_in_time(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            watch(server, broker, labels={"study": "s"}, seconds=30)
            await asyncio.sleep(1)
            rules = {"max_steps": 10_000, "step_rate": 2.0}
            async with AsyncExitStack() as stack:
                host = await stack.enter_async_context(
                    connect(server.url, name="host", token=role_token(server, Role.HOST))
                )
                for labels in ({"study": "s", "pair": "1"}, {"study": "t"}):
                    made = await host.create(
                        "synchronous/01", clock="realtime", labels=labels, **rules
                    )
                    client = await stack.enter_async_context(connect(server.url, name="x"))
                    await client.join(made.code)
                await asyncio.sleep(20)
                (watched,) = {each["episode"] for each in broker.on("steps")}
                room = server.lobby.rooms[watched]
                assert room.labels["study"] == "s"
                await asyncio.sleep(30)
                count = len(broker.on("steps"))
                step = room.episode.step
                await asyncio.sleep(30)
                assert room.episode.step > step
                assert len(broker.on("steps")) == count

    run(main())


def test_watches_are_bounded_replaced_and_ended(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            lab = Lab(server, broker)
            for number in range(MAX_WATCHES):
                assert (await lab.ask("watch", labels={"pair": str(number)})).ok
            assert await lab.refused("watch", labels={"pair": "x"}) == "rate/limited"
            assert (await lab.ask("watch", labels={"pair": "1"})).ok
            assert (await lab.ask("unwatch", labels={"pair": "1"})).done == "1 watches ended"
            both = {"episode": "a", "labels": {"pair": "2"}}
            assert await lab.refused("watch", **both) == "message/invalid-field"
            assert (await lab.ask("unwatch", episode="gone")).done == "0 watches ended"
            assert (await lab.ask("unwatch")).done == f"{MAX_WATCHES - 1} watches ended"

    run(main())
