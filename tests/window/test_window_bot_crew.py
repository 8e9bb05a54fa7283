"""Bots that a player brings along to a kitchen on a server."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from tests.support.server_process import server_process

from robotouille_client import connect
from robotouille_client.window.app.bot_crew import CrewOptions, bot_crew
from robotouille_client.window.app.server_menus import OpenMenu
from robotouille_client.window.app.settings import Settings
from robotouille_client.window.forms.widgets import Choice

PATIENCE = 30


def bots_row(menu: OpenMenu) -> Choice:
    (row,) = (row for row in menu.form.rows if isinstance(row, Choice) and row.label == "Bots")
    return row


def test_bots_leave_a_seat_for_the_player() -> None:
    menu = OpenMenu(Settings(task="multi_agent/01", seats=3))
    assert menu.crew.count == 0, "by default, all seats are for friends"
    assert [words for words, _ in bots_row(menu).options] == [
        "none: 2 seats for friends", "1, and 1 seat for friends", "2",
    ]  # fmt: skip


def test_a_game_for_one_has_no_bots() -> None:
    menu = OpenMenu(Settings(task="synchronous/01", seats=1))
    assert not [row for row in menu.form.rows if row.label == "Bots"]


@pytest.mark.process
async def test_bots_come_to_each_kitchen_and_leave_with_the_player(tmp_path: Path) -> None:
    async def names_of(code: str) -> list[str]:
        (episode,) = [each for each in await ada.episodes() if each.code == code]
        return [seat.kind or "" for seat in episode.seats if seat.name and seat.present]

    async def until(code: str, kinds: list[str]) -> None:
        async with asyncio.timeout(PATIENCE):
            while sorted(await names_of(code)) != kinds:
                await asyncio.sleep(0.1)

    with server_process(tmp_path) as server:
        async with connect(server.url, name="Ada", kind="human") as ada:
            rooms = [(await ada.create("multi_agent/01", seats=3)).code for _ in range(2)]
            with bot_crew(server.url, None, CrewOptions(2, "learner")) as crew:
                for code in rooms:
                    crew.come(code)
                    await until(code, ["bot", "bot"])
                await until(rooms[0], [])
                assert not list(crew.news())
            await until(rooms[1], [])


@pytest.mark.process
async def test_a_bot_that_cannot_come_is_reported_once(tmp_path: Path) -> None:
    with server_process(tmp_path) as server:
        with bot_crew(server.url, None, CrewOptions(1)) as crew:
            crew.come("AAAAA-AAAAA")
            async with asyncio.timeout(PATIENCE):
                while not (found := list(crew.news())):
                    await asyncio.sleep(0.1)
            assert found == ["A bot could not join the game. The terminal shows why."]
            assert not list(crew.news())
