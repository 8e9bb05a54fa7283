"""After a game on a server: again, its replay, its video, the menu."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pygame
import pytest
from tests.support.evening import Evening, wait
from tests.support.servers import serving
from tests.support.virtual_time import run
from tests.support.window_play import post

from robotouille.protocol.messages import Create
from robotouille_client import connect
from robotouille_client.window.shell.settings import Settings, load_settings
from robotouille_server import Server


@pytest.fixture
def evening(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Evening:
    found = Evening(tmp_path)
    found.watch(monkeypatch)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return found


def play(
    evening: Evening,
    script: Callable[[Server], Iterator[None]],
    *,
    watch: bool = False,
    **rules: object,
) -> None:
    """Join a kitchen of a real server, and do what a script says."""

    async def main() -> None:
        async with serving(evening.folder / "server") as server:
            made = {"task": "synchronous/01", "clock": "turn", "max_steps": 3, **rules}
            room = server.lobby.create(Create(**made))  # type: ignore[arg-type]
            evening.shell.settings.prefer(server=server.url)
            evening.shell.ui.clock = asyncio.get_running_loop().time
            evening.fingers.timer.sleep = asyncio.sleep  # type: ignore[method-assign]
            evening.fingers.script = script(server)
            first = evening.shell.remote.join(room.code, watch=watch)
            await asyncio.wait_for(evening.shell.run(first), 600)

    run(main())


def labels(evening: Evening) -> list[str]:
    assert evening.form is not None
    return [row.label for row in evening.form.rows if row.focusable]


def remembered(evening: Evening) -> Settings:
    """What would be known if the process were killed now."""
    return load_settings(evening.folder / "window.json")[0]


def lose(evening: Evening) -> Iterator[None]:
    """Wait until the steps run out, and for the card to listen."""
    while evening.window is None:
        yield
    shown = len(evening.titles)
    while len(evening.titles) == shown:
        post(pygame.K_SPACE)
        yield from wait(5)
    assert evening.titles[-1] == "Not done this time"
    yield from wait(60)


def test_again_replay_video_and_quit(evening: Evening) -> None:
    pytest.importorskip("av")

    def script(server: Server) -> Iterator[None]:
        yield from lose(evening)
        assert labels(evening) == [
            "Play again", "Watch the replay", "Save a video", "Menu", "Quit",
        ]  # fmt: skip
        played = evening.window
        assert remembered(evening).code == "", "a code that is over is not offered"
        yield from evening.choose("Watch the replay")
        assert evening.window is not played
        yield from wait(200)
        post(pygame.K_ESCAPE)
        yield from wait(2)
        yield from evening.choose("Leave the replay")
        yield from evening.choose("Save a video")
        while evening.titles[-1] != "Not done this time":
            yield
        assert evening.form is not None
        (video,) = (evening.folder / "recordings").glob("*.mp4")
        assert evening.form.message == f"The video is saved: {video}"
        assert video.stat().st_size > 1000
        reviewed = evening.window
        settings = evening.shell.settings
        assert settings.code == ""
        yield from evening.choose("Play again")
        while evening.window is reviewed:
            yield
        codes = [room.code for room in server.lobby.rooms.values()]
        assert len(set(codes)) == 2
        assert settings.code == codes[-1]
        assert remembered(evening).code == codes[-1]
        assert remembered(evening).preferences.server == server.url
        yield from lose(evening)
        yield from evening.choose("Quit")
        yield from wait(100)
        raise AssertionError("it goes on after Quit")

    play(evening, script)
    assert not evening.fingers.ended


@pytest.mark.parametrize("missing", ["folder", "extra"])
def test_what_fails_is_told_on_the_card(
    evening: Evening, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    if missing == "folder":
        (evening.folder / "recordings").write_text("no folder")
    else:
        monkeypatch.setitem(sys.modules, "av", None)

    def script(server: Server) -> Iterator[None]:
        yield from lose(evening)
        yield from evening.choose("Save a video")
        assert evening.form is not None
        assert evening.titles[-1] == "Not done this time"
        assert {"folder": "recordings", "extra": "robotouille[video]"}[
            missing
        ] in evening.form.message
        yield from evening.choose("Menu")
        yield from evening.choose("Quit")

    play(evening, script)


def test_who_watched_may_see_it_again(evening: Evening) -> None:
    """Who has chosen no name is no player."""

    def script(server: Server) -> Iterator[None]:
        while evening.window is None:
            yield
        yield from wait(100)
        (room,) = server.lobby.rooms.values()
        assert [member.name for member in room.members] == ["watcher"]
        room.abort("enough")
        yield from wait(100)
        assert labels(evening) == ["Menu", "Quit"], "there was no step"
        yield from evening.choose("Quit")

    play(evening, script, watch=True)


def test_who_watches_is_offered_to_watch_the_next_game(evening: Evening) -> None:
    """The row comes while the card is shown, and nothing is said that the card does not offer."""
    kept: list[asyncio.Task[None]] = []

    def script(server: Server) -> Iterator[None]:
        asked = asyncio.Event()

        async def plays() -> None:
            async with connect(server.url, name="bob", kind="human") as bob:
                (room,) = server.lobby.rooms.values()
                game = await bob.join(room.code)
                while game.outcome is None:
                    await game.next_event()
                await asked.wait()
                await bob.rematch()
                await asyncio.sleep(100)

        while evening.window is None:
            yield
        kept.append(asyncio.ensure_future(plays()))
        (room,) = server.lobby.rooms.values()
        yield from wait(100)
        room.abort("enough")
        yield from wait(100)
        assert labels(evening) == ["Menu", "Quit"]
        asked.set()
        yield from wait(100)
        assert labels(evening) == ["Watch again", "Menu", "Quit"]
        assert evening.form is not None
        assert evening.form.message == "They play again."
        before = evening.window
        yield from evening.choose("Watch again")
        while evening.window is before:
            yield
        yield from wait(50)
        again = list(server.lobby.rooms.values())[-1]
        assert again is not room
        assert {member.name for member in again.members} == {"bob", "watcher"}
        assert [seat.name for seat in again.episode.seats.values()] == ["bob"]
        kept[0].cancel()

    play(evening, script, watch=True)


def test_a_team_meets_again(evening: Evening) -> None:
    """The other one asks first: it is told on the card, and Play again leads to the same kitchen,
    where one's own seat is taken by somebody else."""
    kept: list[asyncio.Task[None]] = []

    def script(server: Server) -> Iterator[None]:
        asked = asyncio.Event()

        async def other() -> None:
            async with connect(server.url, name="bob", kind="human") as bob:
                (room,) = server.lobby.rooms.values()
                game = await bob.join(room.code)
                while game.outcome is None:
                    await game.next_event()
                await asked.wait()
                made = await bob.create(rematch=game.episode)
                await bob.leave()
                await bob.join(made.code, seat="robot1")
                await asyncio.sleep(100)

        while evening.window is None:
            yield
        kept.append(asyncio.ensure_future(other()))
        (room,) = server.lobby.rooms.values()
        yield from wait(100)
        room.abort("enough")
        yield from wait(100)
        assert "Play again" in labels(evening)
        assert evening.form is not None
        assert evening.form.message == ""
        asked.set()
        yield from wait(100)
        assert evening.form.message == "The others play again: so can you."
        before = evening.window
        yield from evening.choose("Play again")
        while evening.window is before:
            yield
        yield from wait(50)
        rooms = list(server.lobby.rooms.values())
        assert len({room.code for room in rooms}) == 2
        there = {s.player: s.name for s in rooms[-1].episode.seats.values()}
        assert there == {"robot1": "bob", "robot2": "player"}
        kept[0].cancel()

    play(evening, script, task="multi_agent/01", seats=2)
