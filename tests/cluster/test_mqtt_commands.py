"""MQTT commands to one node about episodes of another."""

from __future__ import annotations

import asyncio
import json
from contextlib import AsyncExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from robotouille_client import Announced, GameEnded, connect
from robotouille_server.auth import Role
from robotouille_server.mqtt.commands import Commands
from robotouille_server.mqtt.messages import CommandReply
from robotouille_server.mqtt.stream import Watches
from robotouille_server.operator import operator_view
from tests.support.clusters import Node, cluster_of
from tests.support.operator import audited
from tests.support.virtual_time import virtual

pytestmark = pytest.mark.skipif(find_spec("aiomqtt") is None, reason="needs aiomqtt")
TASK = "training/03_multi_agent"


class Lab:
    """Laboratory software that sends commands to one node."""

    def __init__(self, node: Node) -> None:
        watches = Watches(node.server.lobby.rooms.values)
        self._commands = Commands(node.server, watches, asyncio.get_running_loop().time)
        self._token = node.server.tokens.mint_role(Role.OPERATOR, "lab", seconds=3600)
        self._count = 0

    async def ask(self, kind: str, **fields: Any) -> CommandReply:
        self._count += 1
        content = {"type": kind, "ref": f"r{self._count}", "token": self._token, **fields}
        reply = await self._commands.execute(json.dumps(content).encode())
        assert reply is not None
        return reply

    async def refused(self, kind: str, **fields: Any) -> tuple[str, str]:
        error = (await self.ask(kind, **fields)).error
        assert error is not None
        return error.code, error.message


@virtual
async def test_commands_reach_episodes_of_other_nodes(tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        nodes = await stack.enter_async_context(cluster_of(tmp_path, 2))
        for node in nodes:
            await stack.enter_async_context(operator_view(node.server, port=0))
        ada = await stack.enter_async_context(connect(nodes[0].url, name="ada"))
        created = await ada.create("synchronous/01")
        game = await ada.join(created.code)
        owner = nodes.owner(created.episode)
        (other,) = nodes.others(owner)
        await asyncio.sleep(1.5)
        lab, room = Lab(other), owner.server.lobby.rooms[created.episode]
        for kind, paused in (("pause", True), ("resume", False)):
            assert (await lab.ask(kind, episode=created.code)).ok
            assert room.episode.paused is paused
        for fields in ({"episode": created.episode}, {}):
            assert (await lab.ask("announce", text="hello", **fields)).ok
            while not isinstance(await game.next_event(), Announced):
                pass
        listed = await lab.ask("list")
        assert [each.code for each in listed.episodes] == [created.code]
        code, message = await lab.refused("watch", episode=created.code, seconds=60)
        assert (code, owner.url in message) == ("episode/unknown", True)
        assert (await lab.ask("close", episode=created.code)).ok
        while not isinstance(await game.next_event(), GameEnded):
            pass
        assert (await lab.refused("pause", episode=created.code))[0] == "episode/ended"
        noted = [(line["what"], line["by"], line.get("via")) for line in audited(owner.folder)]
        assert noted[:2] == [("pause", "lab", other.url), ("resume", "lab", other.url)]


@virtual
async def test_open_spreads_episodes_over_the_nodes(tmp_path: Path) -> None:
    async with cluster_of(tmp_path, 3) as nodes:
        await asyncio.sleep(1.5)
        reply = await Lab(nodes[0]).ask("open", count=6, create={"task": TASK, "tokens": True})
        assert reply.ok
        assert [len(node.rooms) for node in nodes] == [2, 2, 2]
        assert {each.episode for each in reply.opened} == set().union(*(n.rooms for n in nodes))
        first = reply.opened[0]
        assert first.tokens is not None
        (token, *_) = first.tokens.values()
        async with connect(nodes[0].url, name="ada", token=token) as ada:
            game = await ada.join(first.code)
            assert game.episode == first.episode


@virtual
async def test_a_node_without_operator_page_is_named(tmp_path: Path) -> None:
    async with cluster_of(tmp_path, 2) as nodes, connect(nodes[0].url, name="ada") as ada:
        created = await ada.create(TASK)
        owner = nodes.owner(created.episode)
        (other,) = nodes.others(owner)
        code, message = await Lab(other).refused("pause", episode=created.code)
        assert (code, owner.url in message) == ("node/unavailable", True)
