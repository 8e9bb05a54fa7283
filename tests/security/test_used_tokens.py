"""A token that is good for one session is used up by the first, in whatever process."""

from __future__ import annotations

import json
import os
import stat
import threading
from pathlib import Path

import pytest

from robotouille_server.auth import used_tokens
from robotouille_server.auth.private_files import write_private
from robotouille_server.auth.roles import Role
from tests.support.newcomers import FORWARDED, TWO_COOKS, hello, minted, opened
from tests.support.servers import serving
from tests.support.virtual_time import run

NOW = 1_800_000_000.0


def test_the_first_session_that_joins_uses_a_token_up(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path / "r", require_token=True) as server:
            room = server.lobby.create(TWO_COOKS, owner="")
            join = {"type": "join", "episode": room.code}
            token = minted(server, Role.PLAYER, once=True)
            async with opened(server) as one, opened(server) as two, opened(server) as three:
                for connection in (one, two):
                    assert (await hello(connection, token=token))["type"] == "welcome"
                wrong = {"type": "join", "episode": "AAAAA-AAAAA"}
                assert (await one.ask(wrong))["code"] == "episode/unknown"
                bad = {**join, "seat": "robot9"}
                assert (await one.ask(bad))["code"] == "seat/unknown"
                joined = await two.ask(join, "joined")
                assert joined["type"] == "joined", "what failed has not used it up"
                assert (await one.ask(join))["code"] == "auth/used"
                assert (await hello(three, token=token))["code"] == "auth/used"
                await two.ask({"type": "leave"}, "left")
                joined = await two.ask(join, "joined")
                assert joined["type"] == "joined", "it is the same session"
            await server.stop("restart", hand_over=True)
        async with serving(tmp_path / "r", seed=2, require_token=True) as server:
            async with opened(server) as thief, opened(server) as two:
                assert (await hello(thief, token=token))["code"] == "auth/used"
                assert (await hello(two, resume=joined["resume"]))["resumed"]
                assert (await two.expect("joined"))["seat"] == joined["seat"]

    run(main())


def test_of_two_workers_only_one_takes_it(tmp_path: Path) -> None:
    async def main() -> None:
        state = {"state": tmp_path / "state"}
        async with (
            serving(tmp_path / "a", **state) as first,
            serving(tmp_path / "b", seed=2, **state) as second,
        ):
            token = minted(first, Role.PLAYER, once=True)
            answers = []
            async with opened(first) as one, opened(second) as two:
                for connection in (one, two):
                    assert (await hello(connection, token=token))["type"] == "welcome"
                for server, connection in ((first, one), (second, two)):
                    room = server.lobby.create(TWO_COOKS, owner="")
                    join = {"type": "join", "episode": room.code}
                    answer = await connection.ask(join, "joined")
                    answers.append(answer["code"] if answer["type"] == "error" else "joined")
            assert answers == ["joined", "auth/used"]

    run(main())


def test_what_was_used_is_forgotten_after_the_token_has_expired(tmp_path: Path) -> None:
    now, state = [NOW], tmp_path / "state"

    async def main() -> None:
        async with serving(tmp_path / "r", state=state, wall=lambda: now[0]) as server:
            for hour in (0, 30, 50):
                now[0] = NOW + hour * 3600
                token = minted(server, Role.PLAYER, once=True)
                room = server.lobby.create(TWO_COOKS, owner="")
                async with opened(server, **FORWARDED) as connection:
                    await hello(connection, token=token)
                    await connection.ask({"type": "join", "episode": room.code}, "joined")

    run(main())
    files = list((state / "used-tokens").iterdir())
    assert len(files) == 1 + 1, "those of the hours 30 and 50"
    assert all(json.loads(file.read_text())["session"] for file in files)
    assert {stat.S_IMODE(file.stat().st_mode) for file in files} == {0o600}


def test_the_games_wait_for_one_file_of_a_token_that_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of others are read beside them, and the disk is waited for once."""
    read: list[tuple[str, bool]] = []
    synced: list[int] = []
    reading, sync = used_tokens.read_private, os.fsync

    def noticed(path: Path, most: int) -> bytes:
        read.append((path.name, threading.current_thread() is threading.main_thread()))
        return reading(path, most)

    def counted(descriptor: int) -> None:
        synced.append(descriptor)
        sync(descriptor)

    async def main() -> None:
        others = tmp_path / "state" / "used-tokens"
        async with serving(tmp_path / "r", state=tmp_path / "state") as server:
            room = server.lobby.create(TWO_COOKS, owner="")
            others.mkdir(mode=0o700, parents=True)
            for number in range(20):
                content = json.dumps({"session": "x", "expires": 1.0}).encode()
                write_private(others / f"{number}.json", content, replace=False)
            async with opened(server, **FORWARDED) as connection:
                await hello(connection, token=minted(server, Role.PLAYER, once=True))
                server.services.used_tokens._next_look = 0.0
                monkeypatch.setattr(used_tokens, "read_private", noticed)
                monkeypatch.setattr(os, "fsync", counted)
                await connection.ask({"type": "join", "episode": room.code}, "joined")
                assert len(synced) == 1

    run(main())
    assert {name for name, _ in read} >= {f"{number}.json" for number in range(20)}
    assert not any(in_loop for _, in_loop in read)
    assert len(list((tmp_path / "state" / "used-tokens").iterdir())) == 1
