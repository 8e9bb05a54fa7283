"""Rematches: the same task, rules and seats, and one episode for all players."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from robotouille.episode import SeatTreatment
from robotouille.errors import ProtocolError
from robotouille.protocol.messages import Created
from robotouille_client import Client, Game, connect
from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.rooms import lobby, rematches
from robotouille_server.rooms.rematches import (
    MAX_FINISHED,
    MAX_OPEN,
    MAX_OPEN_OF_GAME,
    RECORDED_BYTES,
    REMATCHES_A_MINUTE,
    REMATCHES_AT_ONCE,
    Rematches,
)
from tests.support.handshakes import FORWARDED, hello, opened
from tests.support.lost_connections import cut
from tests.support.servers import serving, with_clients
from tests.support.virtual_time import virtual

TASK = "multi_agent/02"
RULES = {"clock": "lockstep", "max_steps": 1, "move_budget": 0.0}


async def played(clients: list[Client], **options: object) -> list[Game]:
    """Play an episode of these participants to its end."""
    created = await clients[0].create(TASK, **{**RULES, **options})
    games = [await client.join(created.code) for client in clients]
    await asyncio.gather(*(game.act(None) for game in games))
    assert all(game.finished for game in games)
    return games


async def ended_after_removal(server: Server, ada: Client, eve: Client) -> Created:
    """End an episode from which eve was removed, and in which ada stayed."""
    created = await ada.create(TASK, **RULES)
    await eve.join(created.code)
    room = server.lobby.find(created.code)
    room.kick(next(s for s in room.members if s.name == "eve"), "rude")
    await ada.join(created.code)
    room.abort("over")
    return created


async def restarted(stack: AsyncExitStack, server: Server, folder: Path) -> Server:
    """Replace the server by another process, and return it with reconnected clients."""
    port = server.port
    await server.stop("an update", hand_over=True)
    successor = await stack.enter_async_context(serving(folder, seed=2, port=port))
    await asyncio.sleep(5)
    return successor


@virtual
async def test_removed_participant_cannot_play_again(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "eve") as (server, ada, eve):
        created = await ended_after_removal(server, ada, eve)
        await asyncio.sleep(0.1)
        with pytest.raises(ProtocolError, match="were removed"):
            await eve.create(rematch=created.code)
        assert (await ada.rematch()).phase == "waiting"


@pytest.mark.parametrize("restarts", [False, True])
@virtual
async def test_removed_participant_cannot_join_a_rematch(tmp_path: Path, restarts: bool) -> None:
    async with AsyncExitStack() as stack:
        server, ada = await stack.enter_async_context(with_clients(tmp_path, "ada"))
        token = server.tokens.mint_role(Role.PLAYER, "eve", seconds=3600) if restarts else None
        eve = await stack.enter_async_context(connect(server.url, name="eve", token=token))
        await ended_after_removal(server, ada, eve)
        again = await ada.rematch()
        if restarts:
            await restarted(stack, server, tmp_path)
        for role in ("player", "spectator"):
            with pytest.raises(ProtocolError, match="were removed"):
                await eve.join(again.code, role=role)


@virtual
async def test_participant_removed_after_the_end_cannot_play_again(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "eve") as (server, ada, eve):
        games = await played([ada, eve])
        room = server.lobby.find(games[0].code)
        room.kick(next(s for s in room.members if s.name == "eve"), "rude")
        with pytest.raises(ProtocolError, match="were removed"):
            await eve.create(rematch=games[0].code)


@virtual
async def test_all_players_share_one_rematch(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (server, ada, bob):
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


@virtual
async def test_rematch_is_announced_in_the_ended_room(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob", "eve") as (_, ada, bob, eve):
        games = await played([ada, bob])
        await eve.join(games[0].code, role="spectator")
        assert games[1].rematch_code == ""
        created = await ada.create(rematch=games[0].code)
        await asyncio.sleep(0.2)
        assert eve.game is not None
        assert {games[1].rematch_code, eve.game.rematch_code} == {created.code}
        await bob.leave()
        late = await bob.join(games[0].code, role="spectator")
        await asyncio.sleep(0.1)
        assert late.rematch_code == created.code


@virtual
async def test_players_keep_their_seats(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (_, ada, bob):
        await played([ada, bob])
        second = await bob.rematch()
        first = await ada.rematch()
        assert (first.seat, second.seat) == ("robot1", "robot2")


@virtual
async def test_taken_seat_is_replaced(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob", "eve") as (_, ada, bob, eve):
        games = await played([ada, bob])
        created = await bob.create(rematch=games[0].code)
        await eve.join(created.code, seat="robot1")
        assert (await ada.rematch()).seat == "robot2"


@virtual
async def test_rematch_after_the_room_is_closed(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (server, ada, bob):
        games = await played([ada, bob])
        await asyncio.sleep(300)
        assert not server.lobby.rooms
        one = await ada.create(rematch=games[0].code.lower().replace("-", " "))
        other = await bob.create(rematch=games[0].episode)
        assert one.code == other.code


@virtual
async def test_ended_rematch_can_be_played_again(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (server, ada, bob):
        games = await played([ada, bob])
        one = await ada.create(rematch=games[0].code)
        server.lobby.find(one.code).abort("closed")
        other = await bob.create(rematch=games[0].code)
        assert other.code != one.code


class TestRefusedRematch:
    @virtual
    async def test_spectators_are_refused(self, tmp_path: Path) -> None:
        async with with_clients(tmp_path, "ada", "bob", "eve") as (_, ada, bob, eve):
            games = await played([ada, bob])
            await eve.join(games[0].code, role="spectator")
            with pytest.raises(ProtocolError, match="you had no seat") as refused:
                await eve.create(rematch=games[0].code)
            assert (refused.value.code, refused.value.field) == ("auth/episode", "rematch")

    @virtual
    async def test_player_who_left_may_play_again(self, tmp_path: Path) -> None:
        async with with_clients(tmp_path, "ada", "bob", "eve") as (_, ada, bob, eve):
            created = await ada.create(TASK, **{**RULES, "max_steps": 2})
            first, second = await ada.join(created.code), await eve.join(created.code)
            await asyncio.gather(first.act(None), second.act(None))
            await eve.leave()
            third = await bob.join(created.code)
            await asyncio.gather(first.act(None), third.act(None))
            assert (await eve.create(rematch=created.code)).code

    @virtual
    async def test_running_game_is_refused(self, tmp_path: Path) -> None:
        async with with_clients(tmp_path, "ada", "bob") as (_, ada, _bob):
            created = await ada.create(TASK)
            await ada.join(created.code)
            with pytest.raises(ProtocolError, match="has not ended"):
                await ada.create(rematch=created.code)
            with pytest.raises(ProtocolError, match="no recent episode has"):
                await ada.create(rematch="AAAAA-AAAAA")

    @virtual
    async def test_strangers_learn_no_codes(self, tmp_path: Path) -> None:
        async with with_clients(tmp_path, "ada", "bob", "eve") as (_, ada, bob, eve):
            games = await played([ada, bob])
            with pytest.raises(ProtocolError) as had_no_seat:
                await eve.create(rematch=games[0].episode)
            assert games[0].code not in str(had_no_seat.value)
            running = await ada.create(TASK)
            errors = []
            for name in (running.code, running.episode, "AAAAA-AAAAA"):
                with pytest.raises(ProtocolError) as refused:
                    await eve.create(rematch=name)
                errors.append(str(refused.value))
            assert len(set(errors)) == 1

    @virtual
    async def test_other_options_are_refused(self, tmp_path: Path) -> None:
        async with with_clients(tmp_path, "ada", "bob") as (_, ada, bob):
            games = await played([ada, bob])
            for other in ({"task": TASK}, {"max_steps": 3}, {"tokens": True}):
                with pytest.raises(ProtocolError) as refused:
                    await ada.create(**{"task": None, **other}, rematch=games[0].code)
                assert refused.value.code == "message/invalid-field"
                assert refused.value.field == next(iter(other))

    @virtual
    async def test_player_cannot_fill_the_server(self, tmp_path: Path) -> None:
        async with with_clients(tmp_path, "ada", "bob") as (server, ada, bob):
            codes = []
            for _ in range(MAX_OPEN + 1):
                games = await played([ada, bob])
                codes.append(games[0].code)
                await asyncio.gather(ada.leave(), bob.leave())
            opened = [await ada.create(rematch=code) for code in codes[1:]]
            with pytest.raises(ProtocolError, match="rematches are open") as refused:
                await ada.create(rematch=codes[0])
            assert (refused.value.code, refused.value.field) == ("rate/episodes", "rematch")
            assert (await bob.create(rematch=codes[1])).code == opened[0].code
            server.lobby.find(opened[0].code).abort("closed")
            assert (await ada.create(rematch=codes[0])).code

    @virtual
    async def test_limit_of_episodes_applies(self, tmp_path: Path) -> None:
        async with with_clients(tmp_path, "ada", "bob", max_episodes=1) as (_, ada, bob):
            games = await played([ada, bob])
            one = await bob.create(TASK)
            with pytest.raises(ProtocolError) as refused:
                await ada.create(rematch=games[0].code)
            assert refused.value.code == "server/full"
            assert one.code


ALONE = "synchronous/01"
LEFT = {"clock": "lockstep", "absence": "end"}
"""Options of an episode that ends when its only player leaves."""


async def entered(stack: AsyncExitStack, server: Server, name: str) -> Client:
    """Connect a player with a token of their own."""
    token = server.tokens.mint_role(Role.PLAYER, name, seconds=86_400)
    return await stack.enter_async_context(connect(server.url, name=name, token=token))


async def ended(host: Client, player: Client, **options: object) -> str:
    """End an episode by leaving it; return its code."""
    created = await host.create(ALONE, **{**LEFT, **options})
    await player.join(created.code)
    await player.leave()
    return created.code


async def rematches_in_a_row(player: Client, code: str, most: int) -> tuple[int, str]:
    """Ask for rematches and leave them, until one is refused; return their number and the last."""
    for number in range(most):
        try:
            code = (await player.create(rematch=code)).code
        except ProtocolError as error:
            assert (error.code, error.field) == ("rate/episodes", "rematch")
            assert "try again in" in error.message
            return number, code
        await player.join(code)
        await player.leave()
    return most, code


@virtual
async def test_one_game_does_not_multiply_by_rematches(tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        server, host = await stack.enter_async_context(with_clients(tmp_path, "host"))
        ada, bob, eve = [await entered(stack, server, name) for name in ("ada", "bob", "eve")]
        chain: list[str] = []
        for partner in (bob, bob, bob, bob, eve):
            setup = {"rematch": chain[-1]} if chain else {"task": TASK, **LEFT}
            code = (await (ada if chain else host).create(**setup)).code
            await ada.join(code)
            await partner.join(code)
            await ada.leave()
            await partner.leave()
            chain.append(code)
        askers = (ada, ada, bob, bob)
        opened = [await one.create(rematch=code) for one, code in zip(askers, chain, strict=False)]
        assert len({created.code for created in opened}) == MAX_OPEN_OF_GAME
        with pytest.raises(ProtocolError, match="of this game are open") as refused:
            await eve.create(rematch=chain[-1])
        assert (refused.value.code, refused.value.field) == ("rate/episodes", "rematch")
        # Other games are not concerned.
        await eve.create(rematch=await ended(host, eve))
        server.lobby.find(opened[0].code).abort("over")
        await eve.create(rematch=chain[-1])


@pytest.mark.slow
class TestRateOfRematches:
    @virtual
    async def test_player_cannot_fill_memory_and_disk(self, tmp_path: Path) -> None:
        async with with_clients(tmp_path, "host") as (server, host):
            token = server.tokens.mint_role(Role.PLAYER, "p-1", seconds=86_400)
            async with connect(server.url, name="eve", token=token) as eve:
                first = await ended(host, eve)
                most = int(REMATCHES_AT_ONCE)
                number, last = await rematches_in_a_row(eve, first, most + 20)
                # Time passes, but little.
                assert most <= number <= most + 2
                # Rematches of all games in the row count together.
                assert (await rematches_in_a_row(eve, first, 1))[0] == 0
                await asyncio.sleep(60)
                number, _ = await rematches_in_a_row(eve, last, most)
                assert REMATCHES_A_MINUTE <= number <= REMATCHES_A_MINUTE + 2

    @virtual
    async def test_long_recordings_count_more(self, tmp_path: Path) -> None:
        async with with_clients(tmp_path, "host") as (server, host):
            token = server.tokens.mint_role(Role.PLAYER, "p-1", seconds=86_400)
            async with connect(server.url, name="eve", token=token) as eve:
                first = await ended(host, eve)
                game = await eve.join((await eve.create(rematch=first)).code)
                for _ in range(11 * RECORDED_BYTES // 8000):
                    game.note("plan", "x" * 8000)
                    await asyncio.sleep(1)
                await eve.leave()
                # All requests name the first game, whose own recording is short.
                number = 0
                while (await rematches_in_a_row(eve, first, 1))[0]:
                    number += 1
                assert REMATCHES_AT_ONCE - 13 <= number <= REMATCHES_AT_ONCE - 9

    @pytest.mark.parametrize("moves", [1, 2])
    @virtual
    async def test_rematch_that_moves_to_another_process_is_charged_there(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moves: int
    ) -> None:
        # All games that began in another process share this budget.
        monkeypatch.setattr(rematches, "ARCHIVED_AT_ONCE", 30.0)
        async with AsyncExitStack() as stack:
            server, host = await stack.enter_async_context(with_clients(tmp_path, "host"))
            eve = await entered(stack, server, "eve")
            code = await ended(host, eve)
            code = (await eve.create(rematch=code)).code
            game = await eve.join(code)
            for _ in range(11 * RECORDED_BYTES // 8000):
                game.note("plan", "x" * 8000)
                await asyncio.sleep(1)
            for _ in range(moves):
                server = await restarted(stack, server, tmp_path)
            await eve.leave()
            number, _ = await rematches_in_a_row(eve, code, 40)
            assert 30 - 13 <= number <= 30 - 9

    @virtual
    async def test_open_rematches_count_after_they_have_moved(self, tmp_path: Path) -> None:
        async with AsyncExitStack() as stack:
            server, host = await stack.enter_async_context(with_clients(tmp_path, "host"))
            eve = await entered(stack, server, "eve")
            codes = [await ended(host, eve) for _ in range(MAX_OPEN + 1)]
            for code in codes[1:]:
                await eve.create(rematch=code)
            await restarted(stack, server, tmp_path)
            # The new process reads an ended game when one of its players comes back.
            code = await ended(host, eve)
            with pytest.raises(ProtocolError, match="rematches are open"):
                await eve.create(rematch=code)

    @virtual
    async def test_people_who_play_are_never_refused(self, tmp_path: Path) -> None:
        async with with_clients(tmp_path, "host") as (server, host):
            token = server.tokens.mint_role(Role.PLAYER, "p-1", seconds=86_400)
            async with connect(server.url, name="ada", token=token) as ada:
                code = await ended(host, ada)
                codes = {code}
                for _ in range(100):
                    code = (await ada.create(rematch=code)).code
                    await ada.join(code)
                    await asyncio.sleep(60 / REMATCHES_A_MINUTE)
                    await ada.leave()
                    codes.add(code)
                assert len(codes) == 101

    @virtual
    async def test_hosts_are_not_limited(self, tmp_path: Path) -> None:
        async with with_clients(tmp_path, "host") as (_, host):
            most = int(2 * REMATCHES_AT_ONCE)
            number, _ = await rematches_in_a_row(host, await ended(host, host), most)
            assert number == most

    @virtual
    async def test_games_of_an_earlier_process_share_a_budget(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(rematches, "ARCHIVED_AT_ONCE", 2.0)
        async with AsyncExitStack() as stack:
            server, host = await stack.enter_async_context(with_clients(tmp_path, "host"))
            ada, bob, eve = [await entered(stack, server, name) for name in ("ada", "bob", "eve")]
            for player in (ada, bob, eve):
                await (await player.join((await host.create(ALONE, **RULES)).code)).act(None)
            await restarted(stack, server, tmp_path)
            assert (await ada.rematch()).code
            assert (await bob.rematch()).code
            with pytest.raises(ProtocolError, match="too often"):
                await eve.rematch()


class TestEndedEpisodes:
    @virtual
    async def test_number_of_kept_rooms_is_bounded(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(lobby, "MAX_ENDED", 3)
        async with with_clients(tmp_path, "ada", "bob") as (server, ada, bob):
            first = await ended(ada, bob, grace=86_400.0)
            await ada.join(first, role="spectator")
            codes = [await ended(bob, bob, grace=86_400.0) for _ in range(6)]
            # Besides the latest rooms, the one with a connected participant stays.
            assert {room.code for room in server.lobby.rooms.values()} == {first, *codes[-2:]}
            assert (await bob.create(rematch=codes[0])).code

    @virtual
    async def test_absent_participant_of_a_closed_room_sees_the_end(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(lobby, "MAX_ENDED", 1)
        async with with_clients(tmp_path, "ada", "bob") as (server, ada, bob):
            created = await ada.create(ALONE, **RULES)
            game = await ada.join(created.code)
            server.lobby.find(created.code).abort("the lesson is over")
            cut(ada)
            await ended(bob, bob)
            await asyncio.sleep(30)
            assert game.finished
            assert ada.game is not None
            assert ada.game.outcome is not None


@virtual
async def test_treatments_are_kept_and_labels_are_not(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (server, ada, bob):
        treatments = {"robot1": SeatTreatment(delay_ms=50)}
        games = await played([ada, bob], treatments=treatments, labels={"pair": "p7"})
        created = await bob.create(rematch=games[0].code)
        room = server.lobby.find(created.code)
        assert room.episode.seats["robot1"].treatment.delay_ms == 50
        # All of these are anonymous, and of one owner: nobody.
        assert room.labels == {"pair": "p7"}


@virtual
async def test_rematch_of_a_player_without_a_token_has_no_labels(tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        server, lab = await stack.enter_async_context(with_clients(tmp_path, "lab"))
        code = (await lab.create(TASK, **RULES, labels={"pair": "p7"})).code
        players = []
        for name in ("ada", "bob"):
            player = await stack.enter_async_context(opened(server, **FORWARDED))
            await hello(player, name=name)
            await player.ask({"type": "join", "episode": code}, "joined")
            players.append(player)
        for player in players:
            await player.send({"type": "act", "seq": 1, "action": None})
        await players[0].expect("ended")
        created = await players[0].ask({"type": "create", "rematch": code}, "created")
        assert server.lobby.find(created["code"]).labels == {}


@virtual
async def test_returning_session_may_play_again(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (_, ada, bob):
        games = await played([ada, bob])
        cut(ada)
        await asyncio.sleep(1)
        created = await ada.create(rematch=games[0].code)
        assert created.code


@pytest.mark.parametrize("seconds", [0.0, 300.0], ids=["at once", "when the room is closed"])
@virtual
async def test_session_of_an_earlier_process_may_play_again(tmp_path: Path, seconds: float) -> None:
    async with AsyncExitStack() as stack:
        first, ada, bob = await stack.enter_async_context(with_clients(tmp_path, "ada", "bob"))
        games = await played([ada, bob])
        await asyncio.sleep(seconds)
        await restarted(stack, first, tmp_path)
        one, two = await ada.rematch(), await bob.rematch()
        assert one.code == two.code != games[0].code


@virtual
async def test_unknown_game_is_refused(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (_, *clients):
        games = await played(clients)
    async with with_clients(tmp_path, "ada", seed=2) as (_, ada):
        with pytest.raises(ProtocolError, match="create a new one") as refused:
            await ada.create(rematch=games[0].episode)
        assert (refused.value.code, refused.value.field) == ("episode/unknown", "rematch")


@virtual
async def test_number_of_remembered_games_is_bounded(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (server, ada, bob):
        games = await played([ada, bob])
        room = server.lobby.find(games[0].code)
        kept = Rematches(lambda: 0.0)
        for number in range(MAX_FINISHED + 1):
            room.id, room.code = f"e{number}", f"C{number}"
            kept.add(room)
        assert kept.find("e0") is kept.find("C0") is None
        assert kept.find("e1") is kept.find("c1") is not None
