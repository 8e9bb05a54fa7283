"""Whom an operator sends out stays out, and is told so; who only watched takes up no place."""

from __future__ import annotations

import asyncio
from pathlib import Path

from robotouille_client import Over, connect
from tests.support.lost_connections import cut
from tests.support.servers import raw, serving
from tests.support.virtual_time import run


def test_a_spectator_who_was_sent_out_stays_out(tmp_path: Path) -> None:
    """Neither the resume token nor another `join` opens the door again."""

    async def main() -> None:
        async with serving(tmp_path) as server:
            async with raw(server, name="ada") as ada, raw(server, name="eve") as eve:
                created = await ada.ask({"type": "create"}, "created")
                watch = {"type": "join", "episode": created["code"], "role": "spectator"}
                joined = await eve.ask(watch, "joined")
                room = server.lobby.find(created["code"])
                assert room.spectators == 1
                room.kick(next(s for s in room.members if s.name == "eve"), "rude")
                assert (await eve.expect("left"))["reason"] == "rude"
                assert (await eve.ask(watch, "joined"))["code"] == "episode/banned"
                await eve.socket.close()
                await asyncio.sleep(1)
                async with raw(server, hello=False) as again:
                    hello = {"type": "hello", "protocol": 1, "name": "eve"}
                    answer = await again.ask({**hello, "resume": joined["resume"]}, "welcome")
                    assert answer["code"] == "auth/expired", answer
                    await asyncio.sleep(1)
                    assert (room.spectators, room.members) == (0, [])

    run(main())


def test_who_was_sent_out_while_away_is_told_at_the_return(tmp_path: Path) -> None:
    """The client library does not take the seat again, though it had been cut off."""

    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="ada") as ada,
            connect(server.url, name="eve") as eve,
        ):
            created = await ada.create("multi_agent/02")
            await ada.join(created.code)
            game = await eve.join(created.code)
            room = server.lobby.find(created.code)
            session = next(s for s in room.members if s.name == "eve")
            cut(eve)
            while session.peer is not None:
                await asyncio.sleep(0.001)
            room.kick(session, "rude")
            await asyncio.sleep(60)
            assert eve.connected.is_set()
            assert game.ended
            assert isinstance(game.poll()[-1], Over)
            assert game.seat is not None
            assert not room.episode.seat(game.seat).taken

    run(main())


def test_spectators_who_have_gone_make_room_for_others(tmp_path: Path) -> None:
    """Their place is kept for their return, but not counted."""

    async def main() -> None:
        async with serving(tmp_path, max_spectators=2) as server:
            async with raw(server) as ada, raw(server) as eve:
                created = await ada.ask({"type": "create", "grace": 86400.0}, "created")
                watch = {"type": "join", "episode": created["code"], "role": "spectator"}
                async with raw(server) as one, raw(server) as two:
                    for spectator in (one, two):
                        assert (await spectator.ask(watch, "joined"))["type"] == "joined"
                    assert (await eve.ask(watch, "joined"))["code"] == "episode/full"
                await asyncio.sleep(10)
                assert (await eve.ask(watch, "joined"))["type"] == "joined"

    run(main())
