"""Who leaves a game on a server frees the seat at once; who is stopped comes back into it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Coroutine, Iterator
from pathlib import Path
from typing import Any

import pygame
import pytest
from tests.support.evening import Evening, wait
from tests.support.servers import serving
from tests.support.virtual_time import run
from tests.support.window_play import post

from robotouille.protocol.messages import Create
from robotouille_client import connect
from robotouille_server import Server
from robotouille_server.rooms.room import Room

ME = "robot1"


@pytest.fixture
def evening(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Evening:
    found = Evening(tmp_path)
    found.watch(monkeypatch)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return found


def kitchen(server: Server) -> Room:
    return server.lobby.create(Create(task="multi_agent/02", seats=2))


def names(room: Room) -> set[str]:
    return {seat.name for seat in room.episode.seats.values() if seat.name}


async def sit(
    evening: Evening,
    server: Server,
    script: Iterator[None],
    first: Coroutine[Any, Any, object] | None = None,
) -> None:
    """Open the window, and do what a script says; if that ends, the process is stopped."""
    evening.shell.settings.prefer(server=server.url)
    evening.shell.ui.clock = asyncio.get_running_loop().time
    evening.fingers.timer.sleep = asyncio.sleep  # type: ignore[method-assign]

    def stopping() -> Iterator[None]:
        yield from script
        showing.cancel()
        yield from wait(1000)

    evening.fingers.script = stopping()
    showing = asyncio.create_task(evening.shell.run(first))
    with contextlib.suppress(asyncio.CancelledError):
        await asyncio.wait_for(showing, 600)


def opened(evening: Evening) -> Iterator[None]:
    while evening.window is None:
        yield
    yield from wait(5)


def test_whoever_leaves_frees_the_seat_at_once(evening: Evening) -> None:
    async def main() -> None:
        async with serving(evening.folder / "server") as server:
            room = kitchen(server)
            told: list[object] = []

            def script() -> Iterator[None]:
                yield from opened(evening)
                assert names(room) == {"player", "bob"}
                post(pygame.K_ESCAPE)
                yield from wait(2)
                yield from evening.choose("Leave it")
                assert names(room) == {"bob"}
                yield from evening.choose("Quit")

            async with connect(server.url, name="bob") as bob:
                game = await bob.join(room.code, seat="robot2")
                await sit(evening, server, script(), evening.shell.remote.join(room.code))
                await asyncio.sleep(0.1)
                assert names(room) == {"bob"}
                told += [seat.name for seat in game.seats]
            assert told == ["", "bob"]
            assert not list(evening.folder.rglob("*.seat"))

    run(main())


def test_who_closes_the_window_keeps_the_seat_for_a_while(evening: Evening) -> None:
    """It may have been by mistake, and in a study nobody gets another seat."""

    async def main() -> None:
        async with serving(evening.folder / "server") as server:
            room = kitchen(server)

            def script() -> Iterator[None]:
                yield from opened(evening)
                pygame.event.post(pygame.Event(pygame.QUIT))
                yield from wait(100)
                raise AssertionError("the window is open")

            async with connect(server.url, name="bob") as bob:
                await bob.join(room.code, seat="robot2")
                await sit(evening, server, script(), evening.shell.remote.join(room.code))
                await asyncio.sleep(0.1)
                assert names(room) == {"player", "bob"}
                assert not room.episode.seats[ME].present
                assert list(evening.folder.rglob("*.seat"))

    run(main())


def test_who_is_stopped_comes_back_by_the_list_of_kitchens(
    evening: Evening, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped() -> Iterator[None]:
        yield from opened(evening)
        yield from wait(30)

    async def main() -> None:
        async with (
            serving(evening.folder / "server") as server,
            connect(server.url, name="bob") as bob,
        ):
            kitchen(server)
            room = kitchen(server)
            await bob.join(room.code, seat="robot2")
            await sit(evening, server, stopped(), evening.shell.remote.join(room.code))
            assert names(room) == {"player", "bob"}, "a seat is kept for who is stopped"
            again = Evening(tmp_path / "again")
            again.watch(monkeypatch)

            def back() -> Iterator[None]:
                yield
                yield from again.choose("Kitchens on a server")
                while again.titles[-1] != "Kitchens":
                    yield
                assert again.form is not None
                assert again.form.rows[0].label.endswith("your seat is free: come back")
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
def test_a_signal_is_not_the_window_closed_by_its_owner(
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
