"""Seats that clients lose or keep, and the events they miss."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from robotouille.protocol import messages
from robotouille_client import Announced, ChatReceived, Client, Game, connect
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.bots.seat_session import SeatRequest, play_seat
from robotouille_client.console.kept_seat import kept_seat
from robotouille_client.errors import ConnectionFailedError
from robotouille_client.sansio.game_events import GameEvent
from robotouille_client.window import cli
from robotouille_client.window.app.remote_game import remote_game
from robotouille_client.window.preferences import Preferences
from robotouille_server import Server
from tests.support.lost_connections import cut, start
from tests.support.servers import serving
from tests.support.virtual_time import opening, virtual

NOWHERE = "ws://127.0.0.1:9"
BRIEF = {"grace": 2.0, "clock": "realtime", "absence": "wait"}


async def lose_the_seat(client: Client, server: Server, game: Game) -> None:
    """Cut the connection for longer than the seat is kept. `client.url` then leads nowhere."""
    client.url = NOWHERE
    cut(client)
    await asyncio.sleep(5)
    assert game.seat is not None
    assert not server.lobby.find(game.code).episode.seat(game.seat).taken
    assert not client.connected.is_set()


def of(kind: type[GameEvent], game: Game) -> list[GameEvent]:
    """Return the new events of one kind, and drop the others."""
    return [event for event in game.poll() if isinstance(event, kind)]


@opening(serving)
async def test_chat_before_the_join_is_not_an_event_after_a_reconnect(server: Server) -> None:
    async with connect(server.url, name="ada") as ada, connect(server.url, name="bob") as bob:
        created = await ada.create("multi_agent/02")
        one = await ada.join(created.code)
        for number in range(5):
            one.say(f"number {number}")
        await asyncio.sleep(1)
        two = await bob.join(created.code)
        await asyncio.sleep(1)
        assert of(ChatReceived, two) == []
        cut(bob)
        one.say("bob, are you there?")
        await asyncio.sleep(5)
        assert bob.connected.is_set()
        assert of(ChatReceived, two) == [ChatReceived("ada", "robot1", "bob, are you there?")]


@opening(serving)
async def test_announcements_missed_while_away_arrive_after_the_reconnect(server: Server) -> None:
    async with connect(server.url, name="ada") as ada, connect(server.url, name="bob") as bob:
        one, two = await start(server, ada, bob)
        room = server.lobby.find(two.code)
        room.announce("welcome")
        await asyncio.sleep(1)
        assert of(Announced, two) == [Announced("welcome")]
        cut(bob)
        while room.episode.seat(two.seat).present:
            await asyncio.sleep(0.001)
        room.announce("the study ends in five minutes")
        await asyncio.sleep(5)
        assert bob.connected.is_set()
        assert of(Announced, two) == [Announced("the study ends in five minutes")]
        assert len(of(Announced, one)) == 2


@opening(serving)
async def test_action_of_a_lost_seat_is_not_executed(server: Server) -> None:
    """The action is requested while the seat is lost, and the seat is then taken again."""
    async with connect(server.url, name="ada") as ada, connect(server.url, name="bob") as bob:
        _, game = await start(server, ada, bob, **BRIEF)
        await lose_the_seat(bob, server, game)
        pending = game.submit(game.actions[0])
        bob.url = server.url
        result = await pending
        assert (result.applied, result.code) == (False, "seat/lost")
        await asyncio.sleep(3)
        seat = server.lobby.find(game.code).episode.seat(game.seat)
        assert (seat.taken, seat.tally.acted, seat.tally.rejected) == (True, 0, 0)
        assert (await game.act(game.actions[0])).applied


@opening(serving)
async def test_request_on_a_closed_client_fails_at_once(server: Server) -> None:
    """Another process has taken over the session."""
    async with connect(server.url, name="ada") as ada:
        created = await ada.create("multi_agent/02")
        await ada.join(created.code)
        async with connect(server.url, name="ada", resume=ada.resume):
            while not ada.farewell:
                await asyncio.sleep(0.1)
            for ask in (ada.episodes, ada.leave):
                with pytest.raises(ConnectionFailedError, match="elsewhere"):
                    await asyncio.wait_for(ask(), 60)


async def window(server: Server, code: str, name: str) -> None:
    entry = cli.JoinOptions(server.url, code, None, None, watch=False, token=None, ready=False)
    await cli.run_unattended(
        entry, name, cli.Unattended((320, 240), Preferences(), True, 0.5, None, None)
    )


async def killed(task: asyncio.Task[None]) -> None:
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task


@virtual
async def test_killed_bot_returns_unless_another_seat_is_requested(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    async with serving(tmp_path / "recordings") as server:
        room = server.lobby.create(messages.Create(task="multi_agent/02", seats=3))
        seats = room.episode.seats

        async def bot(seat: str | None) -> asyncio.Task[Any]:
            make = policy_maker(BotKind.RANDOM)
            playing = play_seat(SeatRequest(server.url, ("ada",), None, room.code, seat), make)
            task = asyncio.create_task(playing)
            await asyncio.sleep(1.0)
            return task

        def received() -> list[str]:
            return [line for line in capsys.readouterr().err.splitlines() if "waits" not in line]

        await killed(await bot("robot1"))
        assert received() == [f"ada plays robot1 in {room.code}"]
        for seat in ("robot1", None):
            await killed(await bot(seat))
            assert received() == ["returned to robot1", f"ada plays robot1 in {room.code}"]
        last = await bot("robot2")
        assert received() == [f"ada 2 plays robot2 in {room.code}"]
        assert [seat.present for seat in seats.values()] == [False, True, False]
        await killed(last)
        last = await bot(None)
        assert received() == ["returned to robot2", f"ada 2 plays robot2 in {room.code}"]
        room.abort("enough")
        await last


@pytest.mark.parametrize("view", ["state", "text"])
@opening(serving)
async def test_client_that_resumes_is_ready_if_its_join_says_so(
    server: Server, view: messages.View
) -> None:
    room = server.lobby.create(messages.Create(task="multi_agent/02", seats=2))
    async with connect(server.url, name="ada") as ada:
        await ada.join(room.code, view=view, ready=False)
        for ready in (False, True):
            async with connect(server.url, name="ada", resume=ada.resume) as again:
                await again.join(room.code, view=view, ready=ready)
                assert again.resumed
                await asyncio.sleep(1.0)
                assert room.episode.seats["robot1"].ready == ready


@virtual
async def test_killed_window_that_returns_with_ready_is_ready(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    async with serving(tmp_path / "recordings") as server:
        room = server.lobby.create(messages.Create(task="multi_agent/02", seats=2))
        seat = room.episode.seats["robot1"]

        async def stay(ready: bool) -> None:
            entering = remote_game(
                server.url, room.code, "ada", watch=False, token=None, ready=ready
            )
            async with entering:
                await asyncio.Event().wait()

        # Without --ready, the declaration of the killed window stays.
        for ready, after in ((False, False), (True, True), (False, True)):
            task = asyncio.create_task(stay(ready))
            await asyncio.sleep(1.0)
            assert (seat.name, seat.ready) == ("ada", after)
            await killed(task)


def test_kept_seat_is_private_and_locked(tmp_path: Path) -> None:
    with kept_seat(tmp_path, "ws://a", "KQXZB-MMTRW", "ada") as kept:
        assert kept is not None
        assert kept.token is None
        kept.keep("one.two.three", ["robot2"])
        (path,) = tmp_path.iterdir()
        assert path.stat().st_mode & 0o077 == 0
        with kept_seat(tmp_path, "ws://a", "kqxzbmmtrw", "ada") as other:
            assert other is None
        with kept_seat(tmp_path, "ws://a", "kqxzbmmtrw", "bob") as other:
            assert other is not None
    with kept_seat(tmp_path, "ws://a", "kqxzbmmtrw", "ada") as kept:
        assert kept is not None
        assert (kept.token, kept.seats) == ("one.two.three", ("robot2",))
        assert [kept.token_for(a) for a in ((), "all", ["robot2"])] == ["one.two.three"] * 3
        assert kept.token_for(["robot1"]) is kept.token_for(["robot1", "robot2"]) is None
        kept.forget()
    with kept_seat(tmp_path, "ws://a", "kqxzbmmtrw", "ada") as kept:
        assert kept is not None
        assert kept.token is None
    assert not list(tmp_path.iterdir())


def test_unwritable_state_folder_is_ignored(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with kept_seat(tmp_path / "file" / "seats", "ws://a", "X", "ada") as kept:
        assert kept is None
