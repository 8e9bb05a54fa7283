"""List of a server's kitchens, and leaving a kitchen."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import pygame
import pytest
from tests.support.servers import serving
from tests.support.virtual_time import run, virtual
from tests.support.window_play import post
from tests.support.window_session import WindowSession, wait

from robotouille.protocol.messages import Create
from robotouille_client import connect
from robotouille_client.window.forms.widgets import TextField
from robotouille_server import Server
from robotouille_server.rooms.room import Room

NOWHERE = "ws://127.0.0.1:9"


@pytest.fixture(autouse=True)
def no_server(session: WindowSession) -> None:
    session.app.settings.prefer(server=NOWHERE)


def visit(session: WindowSession, script: Callable[[Server], Iterator[None]]) -> None:
    """Run a script at the menu, with a server that has one kitchen."""

    def whole(server: Server) -> Iterator[None]:
        yield from script(server)
        yield from session.choose("Back")
        yield from session.choose("Quit")
        yield from wait(50)
        raise AssertionError("it goes on after Quit")

    async def main() -> None:
        async with serving(session.folder / "server") as server:
            server.lobby.create(Create(task="synchronous/01", clock="turn"))
            await session.go_online(whole(server))

    run(main())
    assert not session.user.ended


def kitchens(session: WindowSession) -> Iterator[None]:
    yield
    yield from session.choose("Find a kitchen")
    yield from until(session, "Kitchens")


def until(session: WindowSession, title: str) -> Iterator[None]:
    while session.titles[-1] != title:
        yield
    yield from wait(3)


def server_field(session: WindowSession) -> TextField:
    (field,) = [row for row in session.form.rows if isinstance(row, TextField)]
    return field


def test_an_unreachable_server_is_named_and_can_be_changed(session: WindowSession) -> None:
    def script(server: Server) -> Iterator[None]:
        yield from kitchens(session)
        assert session.labels == ["Refresh", "Server", "Back"]
        assert server_field(session).text == NOWHERE
        assert "no answer" in session.form.message
        session.form.focus(server_field(session))
        for _ in NOWHERE:
            post(pygame.K_BACKSPACE)
        yield
        post(server.url)
        yield
        assert session.form.message == ""
        yield from session.choose("Refresh")
        yield from until(session, "Kitchens")
        assert "cheese sandwich" in session.labels[0]
        assert session.app.settings.preferences.server == server.url
        session.form.focus(server_field(session))
        post("0")
        yield
        assert session.labels == ["Refresh", "Server", "Back"], "they are another server's"

    visit(session, script)


def test_a_closed_kitchen_leads_back_to_the_list(session: WindowSession) -> None:
    def script(server: Server) -> Iterator[None]:
        session.app.settings.prefer(server=server.url)
        yield from kitchens(session)
        kitchen, *others = session.labels
        assert others == ["Refresh", "Server", "Back"]
        (room,) = server.lobby.rooms.values()
        room.abort("enough")
        yield from session.choose(kitchen)
        yield from until(session, "Kitchens")
        assert session.form.message
        assert kitchen not in session.labels

    visit(session, script)


ME = "robot1"


def kitchen(server: Server) -> Room:
    return server.lobby.create(Create(task="multi_agent/02", seats=2))


def names(room: Room) -> set[str]:
    return {seat.name for seat in room.episode.seats.values() if seat.name}


async def sit(
    session: WindowSession,
    server: Server,
    script: Iterator[None],
    first: Coroutine[Any, Any, object] | None = None,
) -> None:
    """Open the window and run a script. When the script ends, the process stops."""
    session.app.settings.prefer(server=server.url)

    def stopping() -> Iterator[None]:
        yield from script
        showing.cancel()
        yield from wait(1000)

    showing = asyncio.create_task(session.go_online(stopping(), first))
    with contextlib.suppress(asyncio.CancelledError):
        await showing


def opened(session: WindowSession) -> Iterator[None]:
    while session.window is None:
        yield
    yield from wait(5)


@virtual
async def test_leaving_frees_the_seat_at_once(session: WindowSession) -> None:
    async with serving(session.folder / "server") as server:
        room = kitchen(server)
        received: list[object] = []

        def script() -> Iterator[None]:
            yield from opened(session)
            assert names(room) == {"player", "bob"}
            post(pygame.K_ESCAPE)
            yield from wait(2)
            yield from session.choose("Leave")
            assert names(room) == {"bob"}
            yield from session.choose("Quit")

        async with connect(server.url, name="bob") as bob:
            game = await bob.join(room.code, seat="robot2")
            await sit(session, server, script(), session.app.remote.join(room.code))
            await asyncio.sleep(0.1)
            assert names(room) == {"bob"}
            received += [seat.name for seat in game.seats]
        assert received == ["", "bob"]
        assert not list(session.folder.rglob("*.seat"))


@virtual
async def test_closing_the_window_keeps_the_seat(session: WindowSession) -> None:
    async with serving(session.folder / "server") as server:
        room = kitchen(server)

        def script() -> Iterator[None]:
            yield from opened(session)
            pygame.event.post(pygame.Event(pygame.QUIT))
            yield from wait(100)
            raise AssertionError("the window is open")

        async with connect(server.url, name="bob") as bob:
            await bob.join(room.code, seat="robot2")
            await sit(session, server, script(), session.app.remote.join(room.code))
            await asyncio.sleep(0.1)
            assert names(room) == {"player", "bob"}
            assert not room.episode.seats[ME].present
            assert list(session.folder.rglob("*.seat"))


@pytest.mark.slow
def test_a_stopped_process_returns_from_the_list_of_kitchens(
    session: WindowSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped() -> Iterator[None]:
        yield from opened(session)
        yield from wait(30)

    async def main() -> None:
        async with (
            serving(session.folder / "server") as server,
            connect(server.url, name="bob") as bob,
        ):
            kitchen(server)
            room = kitchen(server)
            await bob.join(room.code, seat="robot2")
            await sit(session, server, stopped(), session.app.remote.join(room.code))
            assert names(room) == {"player", "bob"}, "a seat is kept for who is stopped"
            again = WindowSession(tmp_path / "again")
            again.watch(monkeypatch)

            def back() -> Iterator[None]:
                yield
                yield from again.choose("Find a kitchen")
                while again.titles[-1] != "Kitchens":
                    yield
                assert again.form.rows[0].label.endswith("your seat is kept for you")
                assert again.form.rows[1].label.endswith("2 free")
                yield from again.choose(again.form.rows[0].label)
                yield from opened(again)
                seat = room.episode.seats[ME]
                assert (seat.name, seat.present) == ("player", True)
                pygame.event.post(pygame.Event(pygame.QUIT))
                yield from wait(100)
                raise AssertionError("the window is open")

            await sit(again, server, back())

    run(main())


PROGRAM = "from robotouille_client.window.cli import main; main()"


@pytest.mark.process
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
@pytest.mark.parametrize("shell", [True, False])
def test_a_signal_does_not_count_as_closing_the_window(
    tmp_path: Path, number: signal.Signals, shell: bool
) -> None:
    folders = dict.fromkeys(("XDG_STATE_HOME", "XDG_CONFIG_HOME"), str(tmp_path))
    driver = {"SDL_VIDEODRIVER": "dummy", "SDL_AUDIODRIVER": "dummy", "DISPLAY": ":99"}

    async def main() -> None:
        async with serving(tmp_path / "server") as server:
            room = kitchen(server)
            program = await asyncio.create_subprocess_exec(
                sys.executable, "-c", PROGRAM, room.code, "--url", server.url,
                *([] if shell else ["--headless"]), env={**os.environ, **folders, **driver},
            )  # fmt: skip
            try:
                while not list(tmp_path.rglob("*.seat")) or not names(room):
                    await asyncio.sleep(0.05)
                while not next(tmp_path.rglob("*.seat")).read_text():
                    await asyncio.sleep(0.05)
                program.send_signal(number)
                status = await program.wait()
            finally:
                with contextlib.suppress(ProcessLookupError):
                    program.kill()
            assert status in (128 + number, -number)
            assert names(room) == {"player"}
            assert next(tmp_path.rglob("*.seat")).read_text()

    asyncio.run(asyncio.wait_for(main(), 60))
