"""Handles, owners and limits: nothing leaks from one client to another."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille.errors import RobotouilleError
from robotouille_client import connect
from robotouille_client.mcp_server.open_games import MAX_GAMES_OF_ONE, Caller, OpenGames
from robotouille_server.auth.roles import Role
from tests.support.mcp_agent import agent
from tests.support.newcomers import minted
from tests.support.servers import serving
from tests.support.virtual_time import run

TEAM = "multi_agent/01"


async def free_seats(url: str) -> list[str]:
    async with connect(url, name="eve") as eve:
        (row,) = await eve.episodes()
        return [seat.player for seat in row.seats if not seat.name]


def test_a_handle_is_good_for_its_owner_only(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, OpenGames(server.url).running() as games:
            ada = Caller(minted(server, Role.HOST), "ada", alone=False)
            bob = Caller(minted(server, Role.HOST), "bob", alone=False)
            nobody = Caller(None, "eve", alone=False)
            async with games.visit(ada) as client:
                code = (await client.create(TEAM)).code
            opened = await games.join(ada, code, None, "player")
            with games.using(ada, opened.handle) as found:
                assert found is opened
            for stranger in (nobody, Caller("other", "ada", alone=False)):
                with pytest.raises(RobotouilleError, match="no game with this handle"):
                    with games.using(stranger, opened.handle):
                        pass
            with pytest.raises(RobotouilleError, match="say which game"):
                with games.using(ada, None):
                    pass
            assert bob.token != ada.token

    run(main())


def test_a_game_that_nobody_uses_is_left(tmp_path: Path) -> None:
    """A client that vanished does not hold its seat for ever."""

    async def main() -> None:
        async with serving(tmp_path) as server:
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

    run(main())


def test_a_client_that_goes_leaves_its_seats(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            for mode in ("auto", "legacy"):
                async with agent(server.url, mode=mode) as ada:
                    if mode == "auto":
                        code = await ada.opened(TEAM)
                    await ada.call("join", episode=code)
                    assert await free_seats(server.url) == ["robot2"]
                assert await free_seats(server.url) == ["robot1", "robot2"]

    run(main())


def test_there_are_so_many_games_and_no_more(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            async with agent(server.url, max_games=2) as ada:
                code = await ada.opened(TEAM)
                games = [(await ada.call("join", episode=code))["game"] for _ in range(2)]
                assert "2 games already" in await ada.refused("join", episode=code)
                await ada.call("leave", game=games[0])
                assert "episode/unknown" in await ada.refused("join", episode="XXXXX-XXXXX")
                await ada.call("join", episode=code)

    run(main())


def test_one_token_has_a_share_of_the_games(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, OpenGames(server.url).running() as games:
            ada = Caller(minted(server, Role.HOST), "ada", alone=False)
            async with games.visit(ada) as client:
                code = (await client.create(TEAM)).code
            for _ in range(MAX_GAMES_OF_ONE):
                await games.join(ada, code, None, "spectator")
            with pytest.raises(RobotouilleError, match="leave one"):
                await games.join(ada, code, None, "spectator")
            assert len(games) == MAX_GAMES_OF_ONE
            await games.close_all()
            await games.join(ada, code, None, "spectator")

    run(main())


def test_leaving_ends_a_wait_and_the_handle(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, agent(server.url) as ada:
            code = await ada.opened(TEAM)
            await ada.call("join", episode=code)
            await ada.call("observe")
            waiting = asyncio.create_task(ada.call("wait", timeout_seconds=60))
            await asyncio.sleep(1)
            await ada.call("leave")
            assert "Call leave" in (await waiting)["next"]
            assert "in no game" in await ada.refused("observe")

    run(main())


def test_a_call_that_is_cancelled_changes_nothing(tmp_path: Path) -> None:
    """The client's line broke in the middle of a wait: the game is there, and counts as idle."""

    async def main() -> None:
        async with serving(tmp_path) as server, agent(server.url, idle_seconds=100.0) as ada:
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

    run(main())


async def test_nothing_is_kept_of_tokens_that_have_no_game() -> None:
    games = OpenGames("ws://127.0.0.1:9")
    for number in range(3):
        with pytest.raises(RobotouilleError):
            await games.join(Caller(f"token-{number}", alone=False), "CODE", None, "player")
    assert not games._places
