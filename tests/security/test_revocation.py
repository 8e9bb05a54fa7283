"""Revoked and used tokens."""

from __future__ import annotations

import asyncio
import json
import os
import stat
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jwt
import pytest

from robotouille.errors import ProtocolError
from robotouille_server import Server
from robotouille_server.auth import revocation as used_tokens
from robotouille_server.auth.private_files import write_private
from robotouille_server.auth.revocation import (
    FAILED_JOINS_A_MINUTE,
    KEPT_SECONDS,
    Revocations,
    RevokedFileError,
    load_revoked,
    revoke,
)
from robotouille_server.auth.roles import Role
from tests.support.handshakes import FORWARDED, TWO_COOKS, hello, mint_token, opened
from tests.support.servers import serving
from tests.support.virtual_time import virtual

NOW = 1_800_000_000.0


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "revoked.json"


def test_revocation_is_effective_at_once_and_private(path: Path) -> None:
    revoked = Revocations(path)
    assert "a" not in revoked
    revoke(path, ["a", "b"], NOW + 60, NOW)
    assert "a" in revoked
    assert "c" not in revoked
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    revoke(path, ["c"], NOW + 60, NOW)
    assert revoked.ids == {"a", "b", "c"}


def test_outdated_entries_are_removed(path: Path) -> None:
    revoke(path, ["a"], NOW + 60, NOW)
    revoke(path, ["b"], NOW + 60, NOW + KEPT_SECONDS)
    assert set(load_revoked(path)) == {"a", "b"}
    revoke(path, ["c"], NOW, NOW + KEPT_SECONDS + 61)
    assert set(load_revoked(path)) == {"b", "c"}


def test_concurrent_revocations_are_all_kept(path: Path) -> None:
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda n: revoke(path, [f"t-{n}"], NOW, NOW), range(24)))
    assert len(load_revoked(path)) == 24


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", '{"revoked": [{"id": 1, "until": 2.0}]}', '{"revoked": [7]}']
)
def test_invalid_list_prevents_the_start(path: Path, text: str) -> None:
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(RevokedFileError, match=r"revoked\.json: "):
        Revocations(path)


def test_list_accessible_to_others_is_refused(path: Path) -> None:
    revoke(path, ["a"], NOW, NOW)
    path.chmod(0o666)
    with pytest.raises(RevokedFileError, match="chmod 600"):
        load_revoked(path)


def test_revoked_tokens_stay_revoked_without_the_file(path: Path) -> None:
    revoke(path, ["a"], NOW, NOW)
    revoked = Revocations(path)
    path.write_text("what?")
    assert "a" in revoked
    path.unlink()
    assert "a" in revoked
    revoke(path, ["b"], NOW, NOW)
    assert revoked.ids == {"b"}


def take_back(server: Server, token: str) -> None:
    """Run `robotouille-token revoke` on the server's own files."""
    grant = server.tokens.check_role(token)
    revoke(server.settings.state_folder / "revoked.json", [grant.token_id], grant.expires, NOW)


@virtual
async def test_revocation_closes_connections(tmp_path: Path) -> None:
    async with serving(tmp_path / "r", wall=lambda: NOW) as server:
        room = server.lobby.create(TWO_COOKS, owner="")
        join = {"type": "join", "episode": room.code}
        token = mint_token(server, Role.PLAYER)
        other_token = server.tokens.mint_role(Role.PLAYER, "p-2", seconds=60)
        async with opened(server) as ada, opened(server) as bob, opened(server) as anybody:
            await hello(ada, token=token)
            joined = await ada.ask(join, "joined")
            await hello(bob, token=other_token)
            await bob.ask(join, "joined")
            await hello(anybody)
            take_back(server, token)
            async with asyncio.timeout(2):
                bye = await ada.expect("bye")
            assert (bye["code"], bye.get("retry", False)) == ("auth/revoked", False)
            async with opened(server) as again:
                refused = await hello(again, token=token)
                assert (refused["code"], refused["field"]) == ("auth/revoked", "token")
                refused = await hello(again, resume=joined["resume"])
                assert (refused["code"], refused["field"]) == ("auth/revoked", "resume")
            await asyncio.sleep(3)
            await bob.send({"type": "say", "text": "still here"})
            assert (await bob.expect("said"))["text"] == "still here"
            assert (await anybody.ask({"type": "list"}, "episodes"))["episodes"]
        await server.stop("restart", hand_over=True)
    async with serving(tmp_path / "r", seed=2, wall=lambda: NOW) as server:
        async with opened(server) as again:
            assert (await hello(again, resume=joined["resume"]))["code"] == "auth/revoked"
            assert (await hello(again, token=token))["code"] == "auth/revoked"


@virtual
async def test_revoked_operator_token_is_refused(tmp_path: Path) -> None:
    async with serving(tmp_path / "r", wall=lambda: NOW) as server:
        token = mint_token(server, Role.OPERATOR, episode="AAAAA-BBBBB")
        grant = server.authorize(token)
        assert (grant.subject, grant.episode) == ("p-1", "AAAAA-BBBBB")
        take_back(server, token)
        with pytest.raises(ProtocolError) as caught:
            server.authorize(token)
        assert caught.value.code == "auth/revoked"
        with pytest.raises(ProtocolError):
            server.authorize(mint_token(server, Role.HOST))


@virtual
async def test_token_without_an_id_can_be_revoked(tmp_path: Path) -> None:
    """Its id is a digest of the signed part."""
    async with serving(tmp_path / "r", wall=lambda: NOW) as server:
        key = server.tokens._keyring.signing
        claims = {"aud": "robotouille/role", "role": "player", "sub": "x", "exp": NOW + 60}
        token = jwt.encode(claims, key.secret, "HS256", headers={"kid": key.kid})
        take_back(server, token)
        async with opened(server) as connection:
            assert (await hello(connection, token=token))["code"] == "auth/revoked"


@virtual
async def test_first_join_uses_up_the_token(tmp_path: Path) -> None:
    async with serving(tmp_path / "r", require_token=True) as server:
        room = server.lobby.create(TWO_COOKS, owner="")
        join = {"type": "join", "episode": room.code}
        token = mint_token(server, Role.PLAYER, once=True)
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


@virtual
async def test_only_one_of_two_workers_accepts_it(tmp_path: Path) -> None:
    state = {"state": tmp_path / "state"}
    async with (
        serving(tmp_path / "a", **state) as first,
        serving(tmp_path / "b", seed=2, **state) as second,
    ):
        token = mint_token(first, Role.PLAYER, once=True)
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


@virtual
async def test_use_is_forgotten_after_expiry(tmp_path: Path) -> None:
    now, state = [NOW], tmp_path / "state"
    async with serving(tmp_path / "r", state=state, wall=lambda: now[0]) as server:
        for hour in (0, 30, 50):
            now[0] = NOW + hour * 3600
            token = mint_token(server, Role.PLAYER, once=True)
            room = server.lobby.create(TWO_COOKS, owner="")
            async with opened(server, **FORWARDED) as connection:
                await hello(connection, token=token)
                await connection.ask({"type": "join", "episode": room.code}, "joined")
    files = list((state / "used-tokens").iterdir())
    assert len(files) == 1 + 1, "those of the hours 30 and 50"
    assert all(json.loads(file.read_text())["session"] for file in files)
    assert {stat.S_IMODE(file.stat().st_mode) for file in files} == {0o600}


@virtual
async def test_failed_joins_write_few_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[int] = []
    async with serving(tmp_path) as server:
        room = server.lobby.create(TWO_COOKS, owner="")
        join = {"type": "join", "episode": room.code}
        bad = {**join, "seat": "robot9"}
        token, other = (mint_token(server, Role.PLAYER, once=True) for _ in range(2))
        async with opened(server) as one, opened(server) as two, opened(server) as three:
            for connection, own in ((one, token), (two, token), (three, other)):
                await hello(connection, token=own)
            monkeypatch.setattr(os, "fsync", synced.append)
            answers = [(await one.ask(bad))["code"] for _ in range(FAILED_JOINS_A_MINUTE + 5)]
            assert set(answers) == {"seat/unknown", "rate/limited"}
            assert (await two.ask(join))["code"] == "rate/limited"
            assert len(synced) == FAILED_JOINS_A_MINUTE
            assert (await three.ask(bad))["code"] == "seat/unknown"
            await asyncio.sleep(60 / FAILED_JOINS_A_MINUTE)
            assert (await two.ask(join, "joined"))["type"] == "joined"


@virtual
async def test_join_waits_for_one_file_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Other files are read in a thread, and the disk is synced once."""
    read: list[tuple[str, bool]] = []
    synced: list[int] = []
    reading, sync = used_tokens.read_private, os.fsync

    def noticed(path: Path, most: int) -> bytes:
        read.append((path.name, threading.current_thread() is threading.main_thread()))
        return reading(path, most)

    def counted(descriptor: int) -> None:
        synced.append(descriptor)
        sync(descriptor)

    others = tmp_path / "state" / "used-tokens"
    async with serving(tmp_path / "r", state=tmp_path / "state") as server:
        room = server.lobby.create(TWO_COOKS, owner="")
        others.mkdir(mode=0o700, parents=True)
        for number in range(20):
            content = json.dumps({"session": "x", "expires": 1.0}).encode()
            write_private(others / f"{number}.json", content, replace=False)
        async with opened(server, **FORWARDED) as connection:
            await hello(connection, token=mint_token(server, Role.PLAYER, once=True))
            server.services.used_tokens._next_tidy = 0.0
            monkeypatch.setattr(used_tokens, "read_private", noticed)
            monkeypatch.setattr(os, "fsync", counted)
            await connection.ask({"type": "join", "episode": room.code}, "joined")
            assert len(synced) == 1
    await asyncio.get_running_loop().shutdown_default_executor()
    assert {name for name, _ in read} >= {f"{number}.json" for number in range(20)}
    assert not any(in_loop for _, in_loop in read)
    assert len(list((tmp_path / "state" / "used-tokens").iterdir())) == 1
