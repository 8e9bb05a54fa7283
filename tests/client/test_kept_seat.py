"""Windows and bots that were killed return to their seats."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.bots.seat_session import SeatRequest, play_seat
from robotouille_client.console.kept_seat import kept_seat
from robotouille_client.window import cli
from robotouille_client.window.preferences import Preferences
from robotouille_server import Server
from tests.support.servers import serving
from tests.support.virtual_time import virtual


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

    from robotouille.protocol.messages import Create

    async with serving(tmp_path / "recordings") as server:
        room = server.lobby.create(Create(task="multi_agent/02", seats=3))
        seats = room.episode.seats

        async def bot(seat: str | None) -> asyncio.Task[Any]:
            make = policy_maker(BotKind.RANDOM)
            playing = play_seat(SeatRequest(server.url, ("ada",), None, room.code, seat), make)
            task = asyncio.create_task(playing)
            await asyncio.sleep(1.0)
            return task

        def told() -> list[str]:
            return [line for line in capsys.readouterr().err.splitlines() if "waits" not in line]

        await killed(await bot("robot1"))
        assert told() == [f"ada plays robot1 in {room.code}"]
        for seat in ("robot1", None):
            await killed(await bot(seat))
            assert told() == ["returned to robot1", f"ada plays robot1 in {room.code}"]
        last = await bot("robot2")
        assert told() == [f"ada 2 plays robot2 in {room.code}"]
        assert [seat.present for seat in seats.values()] == [False, True, False]
        await killed(last)
        last = await bot(None)
        assert told() == ["returned to robot2", f"ada 2 plays robot2 in {room.code}"]
        room.abort("enough")
        await last


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
