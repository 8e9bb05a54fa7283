"""Readiness over the wire."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille.errors import ProtocolError
from robotouille.protocol.messages import (
    Create,
    Join,
    Message,
)
from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_client.sansio.client_protocol import ClientProtocol
from robotouille_client.sansio.game_replica import GameReplica
from robotouille_server.rooms.participants.seat_limits import SEAT_CHANGES_AT_ONCE
from tests.support.lost_connections import cut
from tests.support.scripted_server import CODE, ScriptedServer
from tests.support.servers import crash, raw, serving
from tests.support.virtual_time import virtual

TASK = "multi_agent/02"


def sent(client: ClientProtocol[GameReplica]) -> list[Message]:
    """Return all messages sent so far."""
    found = []
    while (message := client.next_message()) is not None:
        found.append(message)
        client.message_sent()
    return found


@virtual
async def test_episode_starts_when_all_are_ready(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, countdown=3.0) as server,
        connect(server.url, name="ada", kind="human") as ada,
        connect(server.url, name="bob", kind="bot") as bob,
    ):
        created = await ada.create(TASK, clock="realtime")
        first = await ada.join(created.code, ready=False)
        second = await bob.join(created.code)
        await asyncio.sleep(60)
        assert [seat.ready for seat in second.seats] == [False, True]
        assert (first.is_ready, second.is_ready) == (False, True)
        assert (first.phase, first.starts_at) == ("waiting", None)
        first.ready()
        await asyncio.sleep(1)
        assert first.is_ready
        assert second.starts_at is not None
        first.ready(False)
        await asyncio.sleep(5)
        assert (second.phase, second.starts_at) == ("waiting", None)
        first.ready()
        await asyncio.sleep(3.1)
        assert first.running
        first.ready(False)
        await asyncio.sleep(1)
        assert first.running
        assert first.is_ready


@virtual
async def test_old_clients_are_ready_at_once(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada, raw(server, text=True) as bob:
        answer = await ada.ask({"type": "create", "task": TASK}, "created")
        join = {"type": "join", "episode": answer["code"]}
        await ada.ask(join, "joined")
        await bob.ask(join, "joined")
        while (roster := await bob.expect("roster"))["phase"] != "running":
            pass
        assert all("ready" not in seat for seat in roster["seats"])


@virtual
async def test_readiness_is_sent_again_after_a_lost_connection(tmp_path: Path) -> None:
    async with (
        serving(tmp_path) as server,
        connect(server.url, name="ada", kind="human") as ada,
        connect(server.url, name="bob") as bob,
    ):
        created = await ada.create(TASK)
        game = await ada.join(created.code, ready=False)
        await bob.join(created.code)
        cut(ada)
        game.ready()
        await asyncio.sleep(2)
        assert game.running


@virtual
async def test_readiness_survives_a_lost_seat(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, grace=1.0) as server,
        connect(server.url, name="ada", kind="human") as ada,
    ):
        created = await ada.create(TASK, grace=1.0)
        game = await ada.join(created.code, ready=False)
        game.ready()
        await asyncio.sleep(0.1)
        url, ada.url = ada.url, "ws://127.0.0.1:9"
        cut(ada)
        await asyncio.sleep(5)
        ada.url = url
        await asyncio.sleep(10)
        seat = server.lobby.find(created.code).episode.seats[game.seat or ""]
        assert (seat.present, seat.ready) == (True, True)


@pytest.mark.parametrize("ready", [False, True])
@virtual
async def test_readiness_survives_a_restart(tmp_path: Path, ready: bool) -> None:
    async with serving(tmp_path) as server:
        port = server.port
        async with connect(server.url, name="ada", kind="human") as ada:
            created = await ada.create(TASK)
            game = await ada.join(created.code, ready=False)
            if ready:
                game.ready()
            await asyncio.sleep(0.1)
            game._ready = None  # It is not told again.
            await crash(server)
            async with serving(tmp_path, port=port) as second:
                await asyncio.sleep(10)
                room = second.lobby.find(created.code)
                assert room.episode.seats["robot1"].present
                assert room.episode.seats["robot1"].ready is ready


@virtual
async def test_readiness_is_recorded(tmp_path: Path) -> None:
    async with (
        serving(tmp_path) as server,
        connect(server.url, name="ada", kind="human") as ada,
    ):
        created = await ada.create("synchronous/01", max_steps=1)
        game = await ada.join(created.code, ready=False)
        game.ready()
        await asyncio.sleep(0.1)
        await game.act(None)
    recording = read_recording(next(tmp_path.rglob("*.rbt")))
    notes = [(note["note"], note.get("ready")) for note in recording.notes()]
    assert notes[:4] == [("roster", None), ("ready", False), ("ready", True), ("started", None)]
    assert recording.verify().ok


@virtual
async def test_spectators_need_not_be_ready(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        room = server.lobby.create(Create(task=TASK))
        await ada.ask({"type": "join", "episode": room.code, "role": "spectator"}, "joined")
        assert (await ada.ask({"type": "ready"}, "error"))["code"] == "seat/none"
        async with connect(server.url, name="eve") as eve:
            game = await eve.join(room.code, role="spectator")
            with pytest.raises(ProtocolError, match="spectators"):
                game.ready()


@virtual
async def test_changes_of_readiness_are_limited(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        answer = await ada.ask({"type": "create", "task": TASK}, "created")
        join = {"type": "join", "episode": answer["code"], "ready": False}
        await ada.ask(join, "joined")
        for number in range(SEAT_CHANGES_AT_ONCE + 5):
            await ada.send({"type": "ready", "ready": number % 2 == 0})
        error = await ada.expect("error")
        assert error["code"] == "rate/seats"
        assert "robot1 has changed its readiness too often" in error["message"]


class TestEarlierServer:
    """Server without readiness: it receives no `ready` and starts when everybody has joined."""

    def test_client_sends_no_ready(self) -> None:
        server = ScriptedServer()
        client = ClientProtocol(GameReplica, url="ws://x", name="ada")
        client.connection_made(0.0)
        sent(client)
        client.receive(server.welcome(), 0.0)
        ref = client.request(Join(episode=CODE, ready=False), 0.0)
        (join,) = sent(client)
        assert isinstance(join, Join)
        assert join.ready
        client.receive(server.joined(ref), 0.0)
        client.receive(server.snapshot(), 0.0)
        assert client.game is not None
        client.game.ready()
        client.game.ready(False)
        assert sent(client) == []
