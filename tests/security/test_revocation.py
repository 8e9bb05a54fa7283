"""A token that was taken back is worth nothing, and neither is what came of it."""

from __future__ import annotations

import asyncio
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jwt
import pytest

from robotouille.errors import ProtocolError
from robotouille_server import Server
from robotouille_server.auth.revocation import (
    KEPT_SECONDS,
    Revocations,
    RevokedFileError,
    load_revoked,
    revoke,
)
from robotouille_server.auth.roles import Role
from tests.support.newcomers import TWO_COOKS, hello, minted, opened
from tests.support.servers import serving
from tests.support.virtual_time import run

NOW = 1_800_000_000.0


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "revoked.json"


def test_what_is_revoked_is_known_at_once_and_kept_privately(path: Path) -> None:
    revoked = Revocations(path)
    assert "a" not in revoked
    revoke(path, ["a", "b"], NOW + 60, NOW)
    assert "a" in revoked
    assert "c" not in revoked
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    revoke(path, ["c"], NOW + 60, NOW)
    assert revoked.ids == {"a", "b", "c"}


def test_entries_go_when_nothing_can_come_of_the_token_any_more(path: Path) -> None:
    revoke(path, ["a"], NOW + 60, NOW)
    revoke(path, ["b"], NOW + 60, NOW + KEPT_SECONDS)
    assert set(load_revoked(path)) == {"a", "b"}
    revoke(path, ["c"], NOW, NOW + KEPT_SECONDS + 61)
    assert set(load_revoked(path)) == {"b", "c"}


def test_many_at_once_lose_nothing(path: Path) -> None:
    """Two operators, each with a command of their own."""
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda n: revoke(path, [f"t-{n}"], NOW, NOW), range(24)))
    assert len(load_revoked(path)) == 24


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", '{"revoked": [{"id": 1, "until": 2.0}]}', '{"revoked": [7]}']
)
def test_a_list_that_cannot_be_read_keeps_the_server_from_starting(path: Path, text: str) -> None:
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(RevokedFileError, match=r"revoked\.json: "):
        Revocations(path)


def test_one_that_others_may_write_is_not_believed(path: Path) -> None:
    revoke(path, ["a"], NOW, NOW)
    path.chmod(0o666)
    with pytest.raises(RevokedFileError, match="chmod 600"):
        load_revoked(path)


def test_what_was_revoked_stays_so_when_the_file_is_spoilt_or_gone(path: Path) -> None:
    revoke(path, ["a"], NOW, NOW)
    revoked = Revocations(path)
    path.write_text("what?")
    assert "a" in revoked
    path.unlink()
    assert "a" in revoked
    revoke(path, ["b"], NOW, NOW)
    assert revoked.ids == {"b"}


def take_back(server: Server, token: str) -> None:
    """`robotouille-token revoke` on the server's own files."""
    grant = server.tokens.check_role(token)
    revoke(server.settings.state_folder / "revoked.json", [grant.token_id], grant.expires, NOW)


def test_it_cuts_who_is_connected_and_lets_nobody_in_again(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path / "r", wall=lambda: NOW) as server:
            room = server.lobby.create(TWO_COOKS, owner="")
            join = {"type": "join", "episode": room.code}
            token = minted(server, Role.PLAYER)
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

    run(main())


def test_an_operators_token_is_refused_too(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path / "r", wall=lambda: NOW) as server:
            token = minted(server, Role.OPERATOR, episode="AAAAA-BBBBB")
            grant = server.authorize(token)
            assert (grant.subject, grant.episode) == ("p-1", "AAAAA-BBBBB")
            take_back(server, token)
            with pytest.raises(ProtocolError) as caught:
                server.authorize(token)
            assert caught.value.code == "auth/revoked"
            with pytest.raises(ProtocolError):
                server.authorize(minted(server, Role.HOST))

    run(main())


def test_a_token_that_names_no_id_can_be_revoked(tmp_path: Path) -> None:
    """Made by a program of somebody else's: its id is a digest of what is signed."""

    async def main() -> None:
        async with serving(tmp_path / "r", wall=lambda: NOW) as server:
            key = server.tokens._keyring.signing
            claims = {"aud": "robotouille/role", "role": "player", "sub": "x", "exp": NOW + 60}
            token = jwt.encode(claims, key.secret, "HS256", headers={"kid": key.kid})
            take_back(server, token)
            async with opened(server) as connection:
                assert (await hello(connection, token=token))["code"] == "auth/revoked"

    run(main())
