"""Handles, owners and limits of open games."""

from __future__ import annotations

import asyncio

import pytest

from robotouille.errors import RobotouilleError
from robotouille_client import connect
from robotouille_client.errors import ConnectionFailedError
from robotouille_client.mcp_server.limits import (
    MAX_CALLS_OF_GAME,
    MAX_GAMES_OF_TOKEN,
    MAX_VISITS_OF_TOKEN,
)
from robotouille_client.mcp_server.open_games import Caller, OpenGames
from robotouille_server import Server
from robotouille_server.auth.roles import Role
from tests.support.handshakes import mint_token
from tests.support.mcp_agent import agent, words
from tests.support.servers import serving
from tests.support.virtual_time import opening, virtual

TEAM = "multi_agent/01"


async def free_seats(url: str) -> list[str]:
    async with connect(url, name="eve") as eve:
        (row,) = await eve.episodes()
        return [seat.player for seat in row.seats if not seat.name]


@opening(serving)
async def test_handle_works_only_for_its_owner(server: Server) -> None:
    async with OpenGames(server.url).running() as games:
        ada = Caller(mint_token(server, Role.HOST), "ada", alone=False)
        bob = Caller(mint_token(server, Role.HOST), "bob", alone=False)
        nobody = Caller(None, "eve", alone=False)
        async with games.visit(ada) as client:
            code = (await client.create(TEAM)).code
        opened = await games.join(ada, code, None, "player")
        async with games.using(ada, opened.handle) as found:
            assert found is opened
        for stranger in (nobody, Caller("other", "ada", alone=False)):
            with pytest.raises(RobotouilleError, match="no game with this handle"):
                async with games.using(stranger, opened.handle):
                    pass
        with pytest.raises(RobotouilleError, match="name the game"):
            async with games.using(ada, None):
                pass
        assert bob.token != ada.token


@opening(serving)
async def test_token_that_is_not_yet_accepted_takes_no_place(server: Server) -> None:
    asked = asyncio.Event()

    async def silent(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        asked.set()
        await reader.read()
        writer.close()

    async with await asyncio.start_server(silent, "127.0.0.1", 0) as slow:
        games = OpenGames(f"ws://127.0.0.1:{slow.sockets[0].getsockname()[1]}", max_games=1)
        async with games.running():
            joining = asyncio.create_task(games.join(Caller("made-up"), TEAM, None, "player"))
            await asked.wait()
            games.url = server.url
            ada = Caller(mint_token(server, Role.HOST), "ada", alone=False)
            async with games.visit(ada) as client:
                code = (await client.create(TEAM)).code
            await games.join(ada, code, None, "player")
            assert len(games) == 1
            joining.cancel()
            await asyncio.wait([joining])


@opening(serving)
async def test_idle_game_is_left(server: Server) -> None:
    """A client that vanished must not keep its seat."""
    async with agent(server.url, idle_seconds=100.0) as ada:
        code = await ada.opened(TEAM)
        await ada.call("join", episode=code)
        await asyncio.sleep(60)
        await ada.call("observe")
        await asyncio.sleep(60)
        assert await free_seats(server.url) == ["robot2"]
        await asyncio.sleep(60)
        assert await free_seats(server.url) == ["robot1", "robot2"]
        assert "call join" in await ada.refused("observe")


@opening(serving)
async def test_game_of_a_removed_client_frees_its_place(server: Server) -> None:
    """A client that the game server has sent away must not keep a place by calling on."""
    async with agent(server.url, max_games=1) as ada:
        code = await ada.opened(TEAM)
        view = await ada.call("join", episode=code)
        (session,) = server.lobby.find(code).members
        assert session.peer is not None
        session.peer.close("auth/revoked", "the operator has revoked your token")
        await asyncio.sleep(30)
        view = await ada.call("observe", game=view["game"])
        assert "revoked your token" in view["next"]
        await asyncio.sleep(20)
        await ada.call("observe", game=view["game"])
        await asyncio.sleep(20)
        assert "call join" in await ada.refused("observe", game=view["game"])
        await ada.call("join", episode=code)


@opening(serving)
async def test_disconnected_client_leaves_its_seats(server: Server) -> None:
    for mode in ("auto", "legacy"):
        async with agent(server.url, mode=mode) as ada:
            if mode == "auto":
                code = await ada.opened(TEAM)
            await ada.call("join", episode=code)
            assert await free_seats(server.url) == ["robot2"]
        assert await free_seats(server.url) == ["robot1", "robot2"]


@opening(serving)
async def test_number_of_games_is_limited(server: Server) -> None:
    async with agent(server.url, max_games=2) as ada:
        code = await ada.opened(TEAM)
        games = [(await ada.call("join", episode=code))["game"] for _ in range(2)]
        assert "already plays 2 games" in await ada.refused("join", episode=code)
        await ada.call("leave", game=games[0])
        assert "episode/unknown" in await ada.refused("join", episode="XXXXX-XXXXX")
        await ada.call("join", episode=code)


@pytest.mark.slow
@opening(serving)
async def test_number_of_games_per_token_is_limited(server: Server) -> None:
    async with OpenGames(server.url).running() as games:
        ada = Caller(mint_token(server, Role.HOST), "ada", alone=False)
        async with games.visit(ada) as client:
            code = (await client.create(TEAM)).code
        for _ in range(MAX_GAMES_OF_TOKEN):
            await games.join(ada, code, None, "spectator")
        with pytest.raises(RobotouilleError, match="leave one"):
            await games.join(ada, code, None, "spectator")
        assert len(games) == MAX_GAMES_OF_TOKEN
        await games.close_all()
        await games.join(ada, code, None, "spectator")


@opening(serving)
async def test_leave_ends_a_wait_and_the_handle(server: Server) -> None:
    async with agent(server.url) as ada:
        code = await ada.opened(TEAM)
        await ada.call("join", episode=code)
        await ada.call("observe")
        waiting = asyncio.create_task(ada.call("wait", timeout_seconds=60))
        await asyncio.sleep(1)
        await ada.call("leave")
        assert "Call leave" in (await waiting)["next"]
        assert "in no game" in await ada.refused("observe")


@opening(serving)
async def test_cancelled_call_changes_nothing(server: Server) -> None:
    """The client disconnects during a wait. The game then exists and counts as idle."""
    async with agent(server.url, idle_seconds=100.0) as ada:
        code = await ada.opened(TEAM)
        await ada.call("join", episode=code)
        await ada.call("observe")
        waiting = asyncio.create_task(ada.call("wait", timeout_seconds=60))
        await asyncio.sleep(1)
        waiting.cancel()
        await asyncio.gather(waiting, return_exceptions=True)
        assert (await ada.call("observe"))["seat"] == "robot1"
        await asyncio.sleep(201)
        assert await free_seats(server.url) == ["robot1", "robot2"]


@opening(serving)
async def test_newer_calls_replace_the_oldest_one(server: Server) -> None:
    """The calls of a client that closes its connection go on, and would use up the memory."""
    async with agent(server.url) as ada:
        code = await ada.opened(TEAM)
        await ada.call("join", episode=code)
        await ada.call("observe")
        waits = [
            asyncio.create_task(ada.client.call_tool("wait", {"timeout_seconds": 60}))
            for _ in range(MAX_CALLS_OF_GAME + 2)
        ]
        await asyncio.sleep(1)
        replaced = [words(wait.result()) for wait in waits if wait.done()]
        assert len(replaced) == 2
        assert all(f"at most {MAX_CALLS_OF_GAME} calls" in said for said in replaced)
        async with connect(server.url, name="bob") as bob:
            await bob.join(code)
            await asyncio.wait(waits)
        answers = [wait.result().structured_content for wait in waits]
        happened = [line for answer in answers if answer for line in answer["happened"]]
        assert any("bob" in line for line in happened)


@pytest.mark.parametrize(("token", "most"), [("ada", MAX_VISITS_OF_TOKEN), (None, 40)])
@virtual
async def test_calls_of_one_token_that_wait_for_the_game_server_are_limited(
    token: str | None, most: int
) -> None:
    async def silent(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read()
        writer.close()

    async def visit(caller: Caller) -> None:
        async with games.visit(caller):
            pass

    async with await asyncio.start_server(silent, "127.0.0.1", 0) as slow:
        games = OpenGames(f"ws://127.0.0.1:{slow.sockets[0].getsockname()[1]}", max_games=40)
        ada, bob = Caller(token, alone=False), Caller("bob", alone=False)
        calls = [asyncio.create_task(visit(ada)) for _ in range(most)]
        await asyncio.sleep(0.1)
        for call in (visit(ada), games.join(ada, TEAM, None, "player")):
            with pytest.raises(RobotouilleError, match="wait for the game server"):
                await call
        bobs = asyncio.create_task(visit(bob))
        await asyncio.sleep(0.1)
        assert not bobs.done()
        failures = await asyncio.gather(*calls, bobs, return_exceptions=True)
        assert {type(failure) for failure in failures} == {ConnectionFailedError}
        with pytest.raises(ConnectionFailedError):
            await visit(ada)
