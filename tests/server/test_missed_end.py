"""Whoever comes back to a game that has ended sees its end, and no other game waits for that."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from robotouille_server import Server, archive
from robotouille_server.archive import FRAMES_A_TURN
from tests.support.servers import crash, raw, serving
from tests.support.virtual_time import run

HELLO = {"type": "hello", "protocol": 1, "name": "bob"}


@asynccontextmanager
async def after_the_end(folder: Path, steps: int = 60) -> AsyncIterator[tuple[Server, str]]:
    """Another server than that on which a game ended, and the token of who missed the end."""
    async with serving(folder) as first:
        async with raw(first) as ada:
            request = {"type": "create", "task": "synchronous/01", "max_steps": steps}
            created = await ada.ask({**request, "clock": "realtime", "step_rate": 50}, "created")
            joined = await ada.ask({"type": "join", "episode": created["code"]}, "joined")
            await ada.expect("ended")
        await first.lobby.closed()
        await crash(first)
    async with serving(folder, seed=2) as second:
        assert not second.lobby.rooms
        yield second, joined["resume"]


def test_other_games_have_their_turns_meanwhile(tmp_path: Path) -> None:
    async def main() -> None:
        async with after_the_end(tmp_path, steps=400) as (server, _):
            turns = 0

            async def count() -> None:
                nonlocal turns
                while True:
                    turns += 1
                    await asyncio.sleep(0)

            other = asyncio.create_task(count())
            await server.lobby.show_end(next(iter(server.lobby._recovery.archive._names)))  # type: ignore[union-attr]
            other.cancel()
            assert turns > 2 * 400 / FRAMES_A_TURN
            assert len(server.lobby.rooms) == 1

    run(main())


def test_what_is_said_meanwhile_is_answered_after_the_welcome(tmp_path: Path) -> None:
    async def main() -> None:
        async with after_the_end(tmp_path) as (server, token):
            async with raw(server, hello=False) as bob:
                await bob.send({**HELLO, "resume": token})
                for ref in (1, 2, 3):
                    await bob.send({"type": "list", "ref": ref})
                welcome = await bob.receive()
                assert (welcome["type"], welcome["resumed"]) == ("welcome", True)
                heard = [await bob.receive() for _ in range(6)]
                assert [m["ref"] for m in heard if m["type"] == "episodes"] == [1, 2, 3]
                (snapshot,) = [m for m in heard if m["type"] == "snapshot"]
                assert (snapshot["step"], snapshot["outcome"]["reason"]) == (60, "step_limit")

    run(main())


@pytest.mark.parametrize(("limit", "value"), [("MAX_STEPS", 59), ("MAX_BYTES", 10_000)])
def test_of_one_that_was_too_long_it_is_said_that_it_is_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, value: int
) -> None:
    monkeypatch.setattr(archive, limit, value)

    async def main() -> None:
        async with after_the_end(tmp_path) as (server, token):
            async with raw(server, hello=False) as bob:
                refused = await bob.ask({**HELLO, "resume": token}, "welcome")
                assert refused["code"] == "auth/expired"
                assert "the episode is over" in refused["message"]
                anew = await bob.ask(HELLO, "welcome")
                assert anew["type"] == "welcome", anew
            assert not server.lobby.rooms

    run(main())


def test_one_that_goes_away_meanwhile_disturbs_nobody(tmp_path: Path) -> None:
    async def main() -> None:
        async with after_the_end(tmp_path, steps=300) as (server, token):
            async with raw(server, hello=False) as bob:
                await bob.send({**HELLO, "resume": token})
                while not server.lobby._recovery.archive._sought:  # type: ignore[union-attr]
                    await asyncio.sleep(0)
                bob.socket.transport.abort()
            async with raw(server, hello=False) as again:
                welcome = await again.ask({**HELLO, "resume": token}, "welcome")
                assert welcome["resumed"] is True
            assert len(server.lobby.rooms) == 1

    run(main())


def test_a_server_that_stops_meanwhile_stops(tmp_path: Path) -> None:
    async def main() -> None:
        async with after_the_end(tmp_path, steps=300) as (server, token):
            async with raw(server, hello=False) as bob:
                await bob.send({**HELLO, "resume": token})
                while not server.lobby._recovery.archive._sought:  # type: ignore[union-attr]
                    await asyncio.sleep(0)
                await server.stop()
            tasks = asyncio.all_tasks() - {asyncio.current_task()}
            assert not [task for task in tasks if "greet_later" in repr(task)]

    run(main())


def test_a_copy_of_a_closed_recording_is_nobodys_end(tmp_path: Path) -> None:
    async def main() -> None:
        async with after_the_end(tmp_path) as (server, token):
            (whole,) = tmp_path.glob("*.rbt")
            (tmp_path / f"a_copy_{whole.name}").write_bytes(whole.read_bytes())
            whole.unlink()
            async with raw(server, hello=False) as bob:
                refused = await bob.ask({**HELLO, "resume": token}, "welcome")
                assert refused["code"] == "auth/expired"

    run(main())


def test_who_has_said_hello_is_not_silent_however_long_it_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was thrown out after twice the time for a `hello`."""
    show = archive.Archive._show

    async def slowly(self: archive.Archive, episode: str) -> None:
        await asyncio.sleep(25)
        await show(self, episode)

    monkeypatch.setattr(archive.Archive, "_show", slowly)

    async def main() -> None:
        async with after_the_end(tmp_path) as (server, token):
            async with raw(server, hello=False) as bob:
                answer = await bob.ask({**HELLO, "resume": token}, "welcome", "bye")
                assert (answer["type"], answer["resumed"]) == ("welcome", True)
            async with raw(server, hello=False) as bob:
                await bob.send({**HELLO, "resume": token})
                await asyncio.sleep(12)
            await asyncio.sleep(1)
            waiting = [t for t in asyncio.all_tasks() if "_greet_later" in str(t.get_coro())]
            assert not waiting, "who has gone is still being looked for"

    run(main())
