"""What the client library says of the time it was away, and of a seat it came too late for."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille_client import Announced, Client, Game, Heard, connect
from robotouille_client.errors import ConnectionFailedError
from robotouille_client.sansio.game_events import GameEvent
from robotouille_server import Server
from tests.support.disks import FullDisk
from tests.support.lost_connections import cut, start
from tests.support.servers import serving
from tests.support.virtual_time import run

NOWHERE = "ws://127.0.0.1:9"
BRIEF = {"grace": 2.0, "clock": "realtime", "absence": "wait"}


async def lose_the_seat(client: Client, server: Server, game: Game) -> None:
    """The line is gone for longer than the seat is kept; `client.url` leads nowhere."""
    client.url = NOWHERE
    cut(client)
    await asyncio.sleep(5)
    assert game.seat is not None
    assert not server.lobby.find(game.code).episode.seat(game.seat).taken
    assert not client.connected.is_set()


def of(kind: type[GameEvent], game: Game) -> list[GameEvent]:
    """The game's news of one kind; all are taken."""
    return [event for event in game.poll() if isinstance(event, kind)]


def test_chat_from_before_one_came_is_no_news_after_a_lost_line(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="ada") as ada,
            connect(server.url, name="bob") as bob,
        ):
            created = await ada.create("multi_agent/02")
            one = await ada.join(created.code)
            for number in range(5):
                one.say(f"number {number}")
            await asyncio.sleep(1)
            two = await bob.join(created.code)
            await asyncio.sleep(1)
            assert of(Heard, two) == []
            cut(bob)
            one.say("bob, are you there?")
            await asyncio.sleep(5)
            assert bob.connected.is_set()
            assert of(Heard, two) == [Heard("ada", "robot1", "bob, are you there?")]

    run(main())


def test_what_the_operator_said_meanwhile_is_told_at_the_return(tmp_path: Path) -> None:
    """Once, and not what was heard before."""

    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="ada") as ada,
            connect(server.url, name="bob") as bob,
        ):
            one, two = await start(server, ada, bob)
            room = server.lobby.find(two.code)
            room.announce("welcome")
            await asyncio.sleep(1)
            assert of(Announced, two) == [Announced("welcome")]
            cut(bob)
            while room.episode.seat(two.seat).present:
                await asyncio.sleep(0.001)
            room.announce("the study ends in five minutes")
            await asyncio.sleep(5)
            assert bob.connected.is_set()
            assert of(Announced, two) == [Announced("the study ends in five minutes")]
            assert len(of(Announced, one)) == 2

    run(main())


def test_an_action_reported_as_lost_does_not_act(tmp_path: Path) -> None:
    """It was asked for while the seat was lost; the seat is taken again, without the action."""

    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="ada") as ada,
            connect(server.url, name="bob") as bob,
        ):
            _, game = await start(server, ada, bob, **BRIEF)
            await lose_the_seat(bob, server, game)
            pending = game.submit(game.actions[0])
            bob.url = server.url
            result = await pending
            assert (result.applied, result.code) == (False, "seat/lost")
            await asyncio.sleep(3)
            seat = server.lobby.find(game.code).episode.seat(game.seat)
            assert (seat.taken, seat.tally.acted, seat.tally.rejected) == (True, 0, 0)
            assert (await game.act(game.actions[0])).applied

    run(main())


def test_who_lost_the_seat_to_another_can_watch(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="ada") as ada,
            connect(server.url, name="bob") as bob,
            connect(server.url, name="eve") as eve,
        ):
            _, game = await start(server, ada, bob, **BRIEF)
            await lose_the_seat(bob, server, game)
            assert (await eve.join(game.code)).seat == game.seat
            bob.url = server.url
            await asyncio.sleep(20)
            assert game.ended
            watching = await bob.join(game.code, role="spectator")
            assert (watching.ended, watching.seat) == (False, None)
            step = watching.step
            await asyncio.sleep(2)
            assert watching.step > step

    run(main())


def test_a_seat_is_taken_again_once_the_disk_has_room(tmp_path: Path) -> None:
    """Nobody is seated while the recording fails: the client asks until it can be done."""

    async def main() -> None:
        disk = FullDisk(tmp_path)
        async with (
            serving(tmp_path, storage=disk) as server,
            connect(server.url, name="ada") as ada,
            connect(server.url, name="bob") as bob,
        ):
            one, two = await start(server, ada, bob, **BRIEF)
            await lose_the_seat(bob, server, two)
            room = server.lobby.find(two.code)
            disk.full = True
            while not room.problem:
                await asyncio.sleep(0.1)
            bob.url = server.url
            await asyncio.sleep(20)
            assert bob.connected.is_set()
            assert not room.episode.seat(two.seat).taken
            disk.full = False
            await asyncio.sleep(20)
            assert not two.ended
            assert room.episode.seat(two.seat).name == "bob"
            assert two.state == one.state
            assert (await two.act(two.actions[0])).applied

    run(main())


def test_a_request_after_the_end_of_the_connection_fails_at_once(tmp_path: Path) -> None:
    """Another machine has taken over; who still asks is told so, and does not wait for ever."""

    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
            created = await ada.create("multi_agent/02")
            await ada.join(created.code)
            async with connect(server.url, name="ada", resume=ada.resume):
                while not ada.farewell:
                    await asyncio.sleep(0.1)
                for ask in (ada.episodes, ada.leave):
                    with pytest.raises(ConnectionFailedError, match="elsewhere"):
                        await asyncio.wait_for(ask(), 60)

    run(main())
