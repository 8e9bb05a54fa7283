"""Who says so is waited for until they are ready, over the wire; others are ready at once."""

from __future__ import annotations

import asyncio
import random
from pathlib import Path

import pytest

from robotouille.errors import ProtocolError
from robotouille.protocol.messages import (
    Create,
    Join,
    Joined,
    Message,
    Roster,
    SeatInfo,
    Welcome,
)
from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_client.sansio.client_protocol import ClientProtocol
from robotouille_client.sansio.game_replica import GameReplica
from robotouille_server.rooms.seats.seat_turnover import SEAT_CHANGES_AT_ONCE
from tests.support.lost_connections import cut
from tests.support.scripted_server import CODE, ScriptedServer
from tests.support.servers import crash, raw, serving
from tests.support.virtual_time import run

TASK = "multi_agent/02"


def sent(client: ClientProtocol[GameReplica]) -> list[Message]:
    """All that there is to send."""
    found = []
    while (message := client.next_message()) is not None:
        found.append(message)
        client.message_sent()
    return found


def test_the_game_begins_when_all_are_ready(tmp_path: Path) -> None:
    async def main() -> None:
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

    run(main())


def test_two_people_who_say_it_at_once(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="ada", kind="human") as ada,
            connect(server.url, name="bob", kind="human") as bob,
        ):
            created = await ada.create(TASK)
            games = [await one.join(created.code, ready=False) for one in (ada, bob)]
            for game in games:
                game.ready()
            await asyncio.sleep(0.1)
            assert all(game.running for game in games)

    run(main())


def test_clients_of_before_are_ready_at_once(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada, raw(server, text=True) as bob:
            answer = await ada.ask({"type": "create", "task": TASK}, "created")
            join = {"type": "join", "episode": answer["code"]}
            await ada.ask(join, "joined")
            await bob.ask(join, "joined")
            while (roster := await bob.expect("roster"))["phase"] != "running":
                pass
            assert all("ready" not in seat for seat in roster["seats"])

    run(main())


def test_it_is_told_again_after_a_lost_connection(tmp_path: Path) -> None:
    async def main() -> None:
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

    run(main())


def test_who_lost_the_seat_and_has_it_anew_is_as_ready_as_before(tmp_path: Path) -> None:
    async def main() -> None:
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

    run(main())


@pytest.mark.parametrize("ready", [False, True])
def test_a_restart_of_the_server_keeps_it(tmp_path: Path, ready: bool) -> None:
    async def main() -> None:
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

    run(main())


def test_it_is_recorded(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="ada", kind="human") as ada,
        ):
            created = await ada.create("synchronous/01", max_steps=1)
            game = await ada.join(created.code, ready=False)
            game.ready()
            await asyncio.sleep(0.1)
            await game.act(None)

    run(main())
    recording = read_recording(next(tmp_path.rglob("*.rbt")))
    notes = [(note["note"], note.get("ready")) for note in recording.notes()]
    assert notes[:4] == [("roster", None), ("ready", False), ("ready", True), ("started", None)]
    assert recording.verify().ok


def test_spectators_are_not_waited_for(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada:
            room = server.lobby.create(Create(task=TASK))
            await ada.ask({"type": "join", "episode": room.code, "role": "spectator"}, "joined")
            assert (await ada.ask({"type": "ready"}, "error"))["code"] == "seat/none"
            async with connect(server.url, name="eve") as eve:
                game = await eve.join(room.code, role="spectator")
                with pytest.raises(ProtocolError, match="spectators"):
                    game.ready()

    run(main())


def test_outside_of_an_episode_it_is_an_error(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada:
            assert (await ada.ask({"type": "ready"}, "error"))["code"] == "episode/none"

    run(main())


def test_to_and_fro_does_not_fill_a_recording(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada:
            answer = await ada.ask({"type": "create", "task": TASK}, "created")
            join = {"type": "join", "episode": answer["code"], "ready": False}
            await ada.ask(join, "joined")
            for number in range(SEAT_CHANGES_AT_ONCE + 5):
                await ada.send({"type": "ready", "ready": number % 2 == 0})
            error = await ada.expect("error")
            assert error["code"] == "rate/seats"
            assert "robot1 was ready, and then not, too often" in error["message"]

    run(main())


class TestAnEarlierServer:
    """It knows nothing of all this: it is told nothing, and begins when all are there."""

    def test_what_it_does_not_know_is_not_sent(self) -> None:
        server = ScriptedServer()
        client = ClientProtocol(GameReplica, url="ws://x", name="ada", rng=random.Random(1))
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

    def test_its_messages_are_read(self) -> None:
        welcome = Welcome(protocol=1, server="x", session="s", resume="r", role="player", grace=1.0)
        assert not welcome.readiness
        assert SeatInfo(player="robot1").ready
        assert Roster(phase="over", seats=[]).rematch == ""
        assert Joined(episode="e", code="c", role="player").seat is None
