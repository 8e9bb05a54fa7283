"""Nodes that were suspended, as an operating system or a virtual machine does it."""

from __future__ import annotations

import asyncio
from pathlib import Path

from robotouille_client import connect
from tests.support.clusters import cluster_of
from tests.support.virtual_time import virtual

TASK = "training/03_multi_agent"
SUSPENDED, STEPS = 60.0, 10


@virtual
async def test_a_game_goes_on_at_once_on_a_node_that_was_suspended_before(tmp_path: Path) -> None:
    async with cluster_of(tmp_path) as nodes:
        async with (
            connect(nodes[0].url, name="ada") as ada,
            connect(nodes[0].url, name="bob") as bob,
        ):
            created = await ada.create(TASK, seats=2, clock="realtime", step_rate=10)
            games = await ada.join(created.code), await bob.join(created.code)
            owner = nodes.owner(created.episode)
            for node in nodes.others(owner):
                node.server.lobby._timers.lost += SUSPENDED
            while games[0].step < STEPS:
                await games[0].next_event()
            await owner.kill()
            begun = asyncio.get_running_loop().time()
            while games[0].step < 2 * STEPS:
                await games[0].next_event()
            assert asyncio.get_running_loop().time() - begun < SUSPENDED / 2
