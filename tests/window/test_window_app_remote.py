"""End of a game on a server: rematch, replay, video and menu."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path

import pygame
import pytest
from tests.support.servers import serving
from tests.support.shifts import file_of
from tests.support.virtual_time import run
from tests.support.window_play import post
from tests.support.window_session import WindowSession, wait

from robotouille.protocol.messages import Create
from robotouille_client import Client, Game, connect
from robotouille_client.window.app.game_cards import StarsRow
from robotouille_server import Server


def play(
    session: WindowSession,
    script: Callable[[Server], Iterator[None]],
    *,
    watch: bool = False,
    tasks: Path | None = None,
    **rules: object,
) -> None:
    """Join a kitchen of a real server, which may have tasks of its own, and run a script."""

    async def main() -> None:
        async with serving(session.folder / "server", tasks=tasks) as server:
            made = {"task": "synchronous/01", "clock": "turn", "max_steps": 3, **rules}
            room = server.lobby.create(Create(**made))
            session.app.settings.prefer(server=server.url)
            await session.go_online(script(server), session.app.remote.join(room.code, watch=watch))

    run(main())


def lose(session: WindowSession) -> Iterator[None]:
    """Wait until the steps run out and the card accepts keys."""
    while session.window is None:
        yield
    shown = len(session.titles)
    while len(session.titles) == shown:
        post(pygame.K_SPACE)
        yield from wait(5)
    assert session.titles[-1] == "Not this time"
    yield from wait(60)


@pytest.mark.slow
def test_rematch_replay_video_and_quit(session: WindowSession) -> None:
    pytest.importorskip("av")

    def script(server: Server) -> Iterator[None]:
        yield from lose(session)
        assert session.labels == [
            "Play again", "Watch the replay", "Save a video", "Menu", "Quit",
        ]  # fmt: skip
        played = session.window
        assert session.remembered.code == "", "a code that is over is not offered"
        yield from session.choose("Watch the replay")
        assert session.window is not played
        yield from wait(200)
        post(pygame.K_ESCAPE)
        yield from wait(2)
        yield from session.choose("Leave the replay")
        yield from session.choose("Save a video")
        while session.titles[-1] != "Not this time":
            yield
        (video,) = (session.folder / "recordings").glob("*.mp4")
        assert session.form.message == f"Video saved: {video}"
        assert video.stat().st_size > 1000
        reviewed = session.window
        settings = session.app.settings
        assert settings.code == ""
        yield from session.choose("Play again")
        while session.window is reviewed:
            yield
        codes = [room.code for room in server.lobby.rooms.values()]
        assert len(set(codes)) == 2
        assert settings.code == codes[-1]
        assert session.remembered.code == codes[-1]
        assert session.remembered.preferences.server == server.url
        yield from lose(session)
        yield from session.choose("Quit")
        yield from wait(100)
        raise AssertionError("it goes on after Quit")

    play(session, script)
    assert not session.user.ended


@pytest.mark.slow
@pytest.mark.parametrize("missing", ["recordings", "robotouille[video]"])
def test_failures_are_shown_on_the_card(
    session: WindowSession, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    if missing == "recordings":
        (session.folder / "recordings").write_text("no folder")
    else:
        monkeypatch.setitem(sys.modules, "av", None)

    def script(server: Server) -> Iterator[None]:
        yield from lose(session)
        yield from session.choose("Save a video")
        yield from wait(20)
        assert session.titles[-1] == "Not this time"
        assert missing in session.form.message
        yield from session.choose("Menu")
        yield from session.choose("Quit")

    play(session, script)


def until_the_end(session: WindowSession, server: Server, bob: Awaitable[None]) -> Iterator[None]:
    """Let Bob play in the first kitchen, and close it when he has joined."""
    while session.window is None:
        yield
    session.others = [asyncio.ensure_future(bob)]
    (room,) = server.lobby.rooms.values()
    yield from wait(100)
    room.abort("enough")
    yield from wait(100)


def reopened(session: WindowSession, button: str) -> Iterator[None]:
    """Choose a button that opens another game, and wait for its window."""
    before = session.window
    yield from session.choose(button)
    while session.window is before:
        yield
    yield from wait(50)
    session.others[0].cancel()


async def play_to_the_end(bob: Client, server: Server) -> Game:
    (room,) = server.lobby.rooms.values()
    game = await bob.join(room.code)
    while game.outcome is None:
        await game.next_event()
    return game


@pytest.mark.slow
def test_spectators_can_watch_the_next_game(session: WindowSession) -> None:
    def script(server: Server) -> Iterator[None]:
        asked = asyncio.Event()

        async def plays() -> None:
            async with connect(server.url, name="bob", kind="human") as bob:
                await play_to_the_end(bob, server)
                await asked.wait()
                await bob.rematch()
                await asyncio.sleep(100)

        yield from until_the_end(session, server, plays())
        assert session.labels == ["Menu", "Quit"]
        asked.set()
        yield from wait(100)
        assert session.labels == ["Watch again", "Menu", "Quit"]
        assert session.form.message == "They play again. Watch on?"
        yield from reopened(session, "Watch again")
        _, again = server.lobby.rooms.values()
        assert {member.name for member in again.members} == {"bob", "watcher"}
        assert [seat.name for seat in again.episode.seats.values()] == ["bob"]

    play(session, script, watch=True)


@pytest.mark.slow
def test_a_team_meets_in_the_same_next_kitchen(session: WindowSession) -> None:
    def script(server: Server) -> Iterator[None]:
        asked = asyncio.Event()

        async def other() -> None:
            async with connect(server.url, name="bob", kind="human") as bob:
                game = await play_to_the_end(bob, server)
                await asked.wait()
                made = await bob.create(rematch=game.episode)
                await bob.leave()
                await bob.join(made.code, seat="robot1")
                await asyncio.sleep(100)

        yield from until_the_end(session, server, other())
        assert "Play again" in session.labels
        assert session.form.message == ""
        asked.set()
        yield from wait(100)
        assert session.form.message == "Your team plays again. Join them!"
        yield from reopened(session, "Play again")
        _, room = server.lobby.rooms.values()
        there = {s.player: s.name for s in room.episode.seats.values()}
        assert there == {"robot1": "bob", "robot2": "player"}

    play(session, script, task="multi_agent/01", seats=2)


@pytest.mark.slow
def test_a_shift_on_a_server_has_its_cards(session: WindowSession) -> None:
    folder = session.folder / "tasks"
    folder.mkdir()
    stars = {"1": [5, 10, 20]}
    (folder / "bar.json").write_text(json.dumps(file_of(steps=3, stars=stars)))

    def script(server: Server) -> Iterator[None]:
        while session.window is None:
            yield
        yield from wait(3)
        words = [row.label for row in session.form.rows]
        assert session.titles[-1] == "Bar"
        assert "Hatch: build dishes here; a complete dish is served." in words
        assert "One star needs 5 points, two need 10, three need 20." in words
        yield from session.choose("Continue")
        post(pygame.K_RETURN)
        while session.source.view().lobby is not None:
            yield
        while session.titles[-1] == "Bar":
            post(pygame.K_SPACE)
            yield from wait(5)
        yield from wait(60)
        assert session.titles[-1] == "Shift over"
        (row,) = [row for row in session.form.rows if isinstance(row, StarsRow)]
        assert (row.stars, row.label) == (0, "One star needs 5 points.")
        yield from session.choose("Quit")

    play(session, script, tasks=folder, task="bar", seats=1, max_steps=100)


def test_kitchens_of_limited_sight_are_offered_to_watch(session: WindowSession) -> None:
    def script(server: Server) -> Iterator[None]:
        yield from wait(20)
        (label,) = (each for each in session.labels if each.endswith("see a part of it (watch)"))
        yield from session.choose(label)
        while session.window is None:
            yield
        (room,) = server.lobby.rooms.values()
        assert room.spectators == 1

    async def main() -> None:
        async with serving(session.folder / "server") as server:
            server.lobby.create(Create(task="synchronous/01", sight=2))
            session.app.settings.prefer(server=server.url)
            await session.go_online(script(server), session.app.remote.choose_kitchen())

    run(main())
