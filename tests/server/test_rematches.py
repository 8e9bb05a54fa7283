"""A team plays a game again: the same task, rules and seats, and all meet in the same episode."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import pytest

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.messages import Create
from robotouille_client import Client, Game, connect
from robotouille_server import Server
from robotouille_server.rooms.directory.rematches import MAX_FINISHED, Rematches
from tests.support.lost_connections import cut
from tests.support.servers import serving
from tests.support.virtual_time import run

TASK = "multi_agent/02"
RULES = {"clock": "lockstep", "max_steps": 1, "move_budget": 0.0}


async def played(clients: list[Client], **options: object) -> list[Game]:
    """A game of all of these, to its end."""
    created = await clients[0].create(TASK, **{**RULES, **options})
    games = [await client.join(created.code) for client in clients]
    await asyncio.gather(*(game.act(None) for game in games))
    assert all(game.over for game in games)
    return games


@asynccontextmanager
async def table(
    folder: Path, *names: str, **options: object
) -> AsyncIterator[tuple[Server, list[Client]]]:
    """A server and some of its clients."""
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(serving(folder, **options))
        clients = [
            await stack.enter_async_context(connect(server.url, name=name)) for name in names
        ]
        yield server, clients


async def restarted(stack: AsyncExitStack, server: Server, folder: Path) -> None:
    """Another process takes the server's place, and its clients come back."""
    port = server.port
    await server.stop("an update", hand_over=True)
    await stack.enter_async_context(serving(folder, seed=2, port=port))
    await asyncio.sleep(5)


def test_who_was_sent_out_cannot_play_it_again(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, "ada", "eve") as (server, (ada, eve)):
            created = await ada.create(TASK, **RULES)
            await eve.join(created.code)
            room = server.lobby.find(created.code)
            room.kick(next(s for s in room.members if s.name == "eve"), "rude")
            await ada.join(created.code)
            room.abort("over")
            await asyncio.sleep(0.1)
            with pytest.raises(ProtocolError, match="sent out"):
                await eve.create(rematch=created.code)
            assert (await ada.rematch()).phase == "waiting"

    run(main())


def test_all_who_ask_meet_in_the_same_game(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, "ada", "bob") as (server, (ada, bob)):
            await played([ada, bob], seed=7)
            first = await ada.rematch()
            assert (first.seat, first.phase) == ("robot1", "waiting")
            second = await bob.rematch()
            assert (second.code, second.seat) == (first.code, "robot2")
            await asyncio.sleep(0.1)
            assert first.running
            room = server.lobby.find(first.code)
            assert room.world.task.name.startswith(TASK)
            assert room.seed == 7
            assert room.episode.rules.max_steps == 1
            assert len(server.lobby.rooms) == 2

    run(main())


def test_who_is_still_in_the_old_game_is_told(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, "ada", "bob", "eve") as (_, (ada, bob, eve)):
            games = await played([ada, bob])
            await eve.join(games[0].code, role="spectator")
            assert games[1].rematch_code == ""
            created = await ada.create(rematch=games[0].code)
            await asyncio.sleep(0.1)
            assert eve.game is not None
            assert {games[1].rematch_code, eve.game.rematch_code} == {created.code}
            await bob.leave()
            late = await bob.join(games[0].code, role="spectator")
            await asyncio.sleep(0.1)
            assert late.rematch_code == created.code

    run(main())


def test_everybody_has_the_seat_again_whoever_comes_first(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, "ada", "bob") as (_, (ada, bob)):
            await played([ada, bob])
            second = await bob.rematch()
            first = await ada.rematch()
            assert (first.seat, second.seat) == ("robot1", "robot2")

    run(main())


def test_a_seat_that_is_taken_is_replaced_by_another(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, "ada", "bob", "eve") as (_, (ada, bob, eve)):
            games = await played([ada, bob])
            created = await bob.create(rematch=games[0].code)
            await eve.join(created.code, seat="robot1")
            assert (await ada.rematch()).seat == "robot2"

    run(main())


def test_it_may_be_asked_for_after_the_old_game_is_forgotten(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, "ada", "bob") as (server, (ada, bob)):
            games = await played([ada, bob])
            await asyncio.sleep(300)
            assert not server.lobby.rooms
            one = await ada.create(rematch=games[0].code.lower().replace("-", " "))
            other = await bob.create(rematch=games[0].episode)
            assert one.code == other.code

    run(main())


def test_once_that_is_over_too_there_is_another(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, "ada", "bob") as (server, (ada, bob)):
            games = await played([ada, bob])
            one = await ada.create(rematch=games[0].code)
            server.lobby.find(one.code).abort("closed")
            other = await bob.create(rematch=games[0].code)
            assert other.code != one.code

    run(main())


class TestRefused:
    def test_who_had_no_seat(self, tmp_path: Path) -> None:
        async def main() -> None:
            async with table(tmp_path, "ada", "bob", "eve") as (_, (ada, bob, eve)):
                games = await played([ada, bob])
                await eve.join(games[0].code, role="spectator")
                with pytest.raises(ProtocolError, match="you had no seat") as refused:
                    await eve.create(rematch=games[0].code)
                assert (refused.value.code, refused.value.field) == ("auth/episode", "rematch")

        run(main())

    def test_who_left_before_the_end_had_one(self, tmp_path: Path) -> None:
        async def main() -> None:
            async with table(tmp_path, "ada", "bob", "eve") as (_, (ada, bob, eve)):
                created = await ada.create(TASK, **{**RULES, "max_steps": 2})
                first, second = await ada.join(created.code), await eve.join(created.code)
                await asyncio.gather(first.act(None), second.act(None))
                await eve.leave()
                third = await bob.join(created.code)
                await asyncio.gather(first.act(None), third.act(None))
                assert (await eve.create(rematch=created.code)).code

        run(main())

    def test_a_game_that_is_not_over(self, tmp_path: Path) -> None:
        async def main() -> None:
            async with table(tmp_path, "ada", "bob") as (_, (ada, _bob)):
                created = await ada.create(TASK)
                await ada.join(created.code)
                with pytest.raises(ProtocolError, match="not over"):
                    await ada.create(rematch=created.code)
                with pytest.raises(ProtocolError, match="no episode has"):
                    await ada.create(rematch="AAAAA-AAAAA")

        run(main())

    def test_another_task_or_rule(self, tmp_path: Path) -> None:
        async def main() -> None:
            async with table(tmp_path, "ada", "bob") as (_, (ada, bob)):
                games = await played([ada, bob])
                for other in ({"task": TASK}, {"max_steps": 3}, {"tokens": True}):
                    with pytest.raises(ProtocolError) as refused:
                        await ada.create(**{"task": None, **other}, rematch=games[0].code)
                    assert refused.value.code == "message/invalid-field"
                    assert refused.value.field == next(iter(other))

        run(main())

    def test_more_games_than_there_may_be(self, tmp_path: Path) -> None:
        async def main() -> None:
            async with table(tmp_path, "ada", "bob", max_episodes=1) as (_, (ada, bob)):
                games = await played([ada, bob])
                one = await bob.create(TASK)
                with pytest.raises(ProtocolError) as refused:
                    await ada.create(rematch=games[0].code)
                assert refused.value.code == "server/full"
                assert one.code

        run(main())

    def test_where_nobody_who_asks_is_known(self, tmp_path: Path) -> None:
        """Commands from a broker, and the server itself, had no seat."""

        async def main() -> None:
            async with table(tmp_path, "ada", "bob") as (server, (ada, bob)):
                games = await played([ada, bob])
                with pytest.raises(ProtocolError, match="you had no seat"):
                    server.lobby.create(Create(rematch=games[0].code))

        run(main())


def test_what_a_study_does_stays_and_its_labels_stay_its_own(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, "ada", "bob") as (server, (ada, bob)):
            treatments = {"robot1": messages.SeatTreatment(delay_ms=50)}
            games = await played([ada, bob], treatments=treatments, labels={"pair": "p7"})
            created = await bob.create(rematch=games[0].code)
            room = server.lobby.find(created.code)
            assert room.episode.seats["robot1"].treatment.delay_ms == 50
            # All of these are anonymous, and of one owner: nobody.
            assert room.labels == {"pair": "p7"}

    run(main())


def test_who_comes_back_with_a_resume_token_had_the_seat(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, "ada", "bob") as (_, (ada, bob)):
            games = await played([ada, bob])
            cut(ada)
            await asyncio.sleep(1)
            created = await ada.create(rematch=games[0].code)
            assert created.code

    run(main())


@pytest.mark.parametrize("seconds", [0.0, 300.0], ids=["at once", "when the room is closed"])
def test_who_comes_back_after_a_restart_can_play_it_again(tmp_path: Path, seconds: float) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            first, (ada, bob) = await stack.enter_async_context(table(tmp_path, "ada", "bob"))
            games = await played([ada, bob])
            await asyncio.sleep(seconds)
            await restarted(stack, first, tmp_path)
            one, two = await ada.rematch(), await bob.rematch()
            assert one.code == two.code != games[0].code

    run(main())


def test_a_game_that_nobody_came_back_to_is_too_long_ago(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, "ada", "bob") as (_, clients):
            games = await played(clients)
        async with table(tmp_path, "ada", seed=2) as (_, (ada,)):
            with pytest.raises(ProtocolError, match="too long ago: open a new one") as refused:
                await ada.create(rematch=games[0].episode)
            assert (refused.value.code, refused.value.field) == ("episode/unknown", "rematch")

    run(main())


def test_old_games_are_forgotten(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, "ada", "bob") as (server, (ada, bob)):
            games = await played([ada, bob])
            room = server.lobby.find(games[0].code)
            kept = Rematches()
            for number in range(MAX_FINISHED + 1):
                room.id, room.code = f"e{number}", f"C{number}"
                kept.add(room)
            assert kept.find("e0") is kept.find("C0") is None
            assert kept.find("e1") is kept.find("c1") is not None

    run(main())
