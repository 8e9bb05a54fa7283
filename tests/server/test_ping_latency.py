"""The operator's view shows the round trip of a ping that was really sent."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from robotouille_client import Client
from robotouille_server import Server
from robotouille_server.transport.peer import Peer
from tests.support.operator import Table, table, viewing
from tests.support.virtual_time import run

PING_SECONDS = 20
"""Between two pings of the server."""
SLOW = 0.4
"""Seconds for which somebody does not hear the ping."""


def peers(server: Server, here: Table) -> dict[str, Peer]:
    members = server.lobby.find(here.code).members
    return {member.name: member.peer for member in members if member.peer is not None}


@asynccontextmanager
async def not_listening(client: Client) -> AsyncIterator[None]:
    """What is sent to this client meanwhile is heard afterwards."""
    assert client._socket is not None
    transport = client._socket.transport
    transport.pause_reading()
    yield
    transport.resume_reading()


def test_latency_is_that_of_a_ping_that_came_back(tmp_path: Path) -> None:
    """Nothing is known before the first ping; then the time is that of the way there and back."""

    async def main() -> None:
        loop = asyncio.get_running_loop()
        async with viewing(tmp_path) as (server, _, api):
            begun = loop.time()
            async with table(server) as here:
                assert await shown(api, here) == {"ada": None, "bob": None}
                await asyncio.sleep(begun + PING_SECONDS - 0.1 - loop.time())
                assert [peer.latency for peer in peers(server, here).values()] == [0.0, 0.0]
                async with not_listening(here.clients[0]):
                    await asyncio.sleep(0.1 + SLOW)
                await asyncio.sleep(1)
                latency = peers(server, here)["ada"].latency
                assert SLOW - 0.1 < latency < SLOW + 0.5
                assert peers(server, here)["bob"].latency < SLOW - 0.1
                assert (await shown(api, here))["ada"] == round(1000 * latency, 1)

    run(main())


async def shown(api: Any, here: Table) -> dict[str, float | None]:
    """The milliseconds that the operator sees, by name."""
    row = await api.row(here.episode)
    return {seat["name"]: seat["latency_ms"] for seat in row["seats"]}
