"""A game in real time with people in it is counted down to, once everybody is there."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille_client import connect
from robotouille_server.runtime.settings import ServerSettings
from tests.support.servers import serving
from tests.support.virtual_time import run

TASK = "multi_agent/02"


def test_three_seconds_unless_the_operator_says_otherwise() -> None:
    assert ServerSettings().rules().countdown == 3.0
    assert ServerSettings(countdown=0.0).rules().countdown == 0.0


def test_everybody_is_told_when_it_begins(tmp_path: Path) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        async with (
            serving(tmp_path, countdown=3.0) as server,
            connect(server.url, name="ada", kind="human") as ada,
            connect(server.url, name="bob", kind="bot") as bob,
        ):
            created = await ada.create(TASK, clock="realtime", step_rate=10.0)
            first = await ada.join(created.code)
            assert first.starts_at is None
            second = await bob.join(created.code)
            begins = second.starts_at
            assert second.phase == "waiting"
            assert begins is not None
            assert begins - loop.time() == pytest.approx(3.0, abs=0.1)
            await asyncio.sleep(0.5)
            assert first.starts_at == pytest.approx(begins, abs=0.1)
            await asyncio.sleep(2.4)
            assert (second.phase, second.step) == ("waiting", 0)
            await asyncio.sleep(0.2)
            assert (first.phase, second.phase) == ("running", "running")
            assert (first.starts_at, second.starts_at) == (None, None)

    run(main())


def test_who_was_killed_before_the_other_came_is_waited_for(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, countdown=3.0) as server,
            connect(server.url, name="bob", kind="human") as bob,
        ):
            async with connect(server.url, name="ada", kind="human") as ada:
                created = await ada.create(TASK, clock="realtime")
                await ada.join(created.code)
                assert ada._socket is not None
                ada._socket.transport.abort()
                ada.url = "ws://127.0.0.1:9"
                game = await bob.join(created.code)
                await asyncio.sleep(20)
                assert game.phase == "waiting"
                assert [seat.present for seat in game.seats] == [False, True]
                episode = server.lobby.find(created.code).episode
                assert (episode.step, episode.starts_at) == (0, None)

    run(main())
