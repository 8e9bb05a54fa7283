"""The kitchens of a server: which server is asked, and what a kitchen that is gone leads to."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from pathlib import Path

import pygame
import pytest
from tests.support.evening import Evening, wait
from tests.support.servers import serving
from tests.support.virtual_time import run
from tests.support.window_play import post

from robotouille.protocol.messages import Create
from robotouille_client.window.forms.text_field import TextField
from robotouille_client.window.shell.settings import Settings, settings_path
from robotouille_client.window.shell.starting import open_shell
from robotouille_server import Server

NOWHERE = "ws://127.0.0.1:9"


@pytest.fixture
def evening(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Evening:
    found = Evening(tmp_path, Settings(learned=True, size=(640, 480), server=NOWHERE))
    found.watch(monkeypatch)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return found


def visit(evening: Evening, script: Callable[[Server], Iterator[None]]) -> None:
    """Do what a script says at the menu, with a server that has a kitchen."""

    async def main() -> None:
        async with serving(evening.folder / "server") as server:
            server.lobby.create(Create(task="synchronous/01", clock="turn"))  # type: ignore[arg-type]
            evening.shell.ui.clock = asyncio.get_running_loop().time
            evening.fingers.timer.sleep = asyncio.sleep  # type: ignore[method-assign]
            evening.fingers.script = script(server)
            await asyncio.wait_for(evening.shell.run(), 600)

    run(main())
    assert not evening.fingers.ended


def labels(evening: Evening) -> list[str]:
    assert evening.form is not None
    return [row.label for row in evening.form.rows]


def kitchens(evening: Evening) -> Iterator[None]:
    yield
    yield from evening.choose("Kitchens on a server")
    yield from until(evening, "Kitchens")


def until(evening: Evening, title: str) -> Iterator[None]:
    while evening.titles[-1] != title:
        yield
    yield from wait(3)


def server_field(evening: Evening) -> TextField:
    assert evening.form is not None
    (field,) = [row for row in evening.form.rows if isinstance(row, TextField)]
    return field


def test_a_server_that_cannot_be_reached_is_named_and_can_be_changed(evening: Evening) -> None:
    def script(server: Server) -> Iterator[None]:
        yield from kitchens(evening)
        assert labels(evening) == ["Look again", "Server", "Back"]
        assert server_field(evening).text == NOWHERE
        assert evening.form is not None
        assert "nobody answers" in evening.form.message
        evening.form.focus(server_field(evening))
        for _ in NOWHERE:
            post(pygame.K_BACKSPACE)
        yield
        post(server.url)
        yield
        assert evening.form.message == ""
        yield from evening.choose("Look again")
        yield from until(evening, "Kitchens")
        assert "cheese sandwich" in labels(evening)[0]
        assert evening.shell.settings.preferences.server == server.url
        evening.form.focus(server_field(evening))
        post("0")
        yield
        assert labels(evening) == ["Look again", "Server", "Back"], "they are another server's"
        yield from evening.choose("Back")
        yield from evening.choose("Quit")
        yield from wait(50)
        raise AssertionError("it goes on after Quit")

    visit(evening, script)


def test_a_kitchen_that_is_gone_leads_back_to_those_that_there_are(evening: Evening) -> None:
    def script(server: Server) -> Iterator[None]:
        evening.shell.settings.prefer(server=server.url)
        yield from kitchens(evening)
        kitchen, *others = labels(evening)
        assert others == ["Look again", "Server", "Back"]
        (room,) = server.lobby.rooms.values()
        room.abort("enough")
        yield from evening.choose(kitchen)
        yield from until(evening, "Kitchens")
        assert evening.form is not None
        assert evening.form.message
        assert kitchen not in labels(evening)
        yield from evening.choose("Back")
        yield from evening.choose("Quit")
        yield from wait(50)
        raise AssertionError("it goes on after Quit")

    visit(evening, script)


def test_the_server_of_the_command_line_is_asked_in_this_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setattr("robotouille_client.window.shell.starting.require_screen", lambda: None)
    shell = open_shell(server=NOWHERE)
    try:
        assert shell.ui.preferences.server == NOWHERE
        shell.ui.remember()
        assert NOWHERE not in settings_path().read_text()
    finally:
        shell.ui.close()
