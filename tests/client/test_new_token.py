"""A client whose old session is not taken back comes in with its token, where it has one."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille import ProtocolError
from robotouille_client import Client, connect
from robotouille_server.auth.revocation import revoke
from robotouille_server.auth.roles import Role
from tests.support.servers import serving
from tests.support.virtual_time import run

NOW = 1_800_000_000.0


def test_a_new_token_counts_where_the_old_one_was_revoked(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path / "r", wall=lambda: NOW) as server:
            old, new = (server.tokens.mint_role(Role.HOST, "p-1", seconds=60) for _ in range(2))
            async with connect(server.url, name="ada", token=old) as ada:
                created = await ada.create("multi_agent/02")
                await ada.join(created.code)
                resume = ada.resume
            grant = server.tokens.check_role(old)
            path = server.settings.state_folder / "revoked.json"
            revoke(path, [grant.token_id], grant.expires, NOW)
            client = Client(server.url, name="ada", token=new, resume=resume)
            async with client:
                assert (await client.join(created.code)).seat == "robot2"
            with pytest.raises(ProtocolError) as caught:
                async with connect(server.url, name="ada", token=old):
                    pass
            assert caught.value.code == "auth/revoked"

    run(main())


def test_a_token_counts_where_the_server_asks_for_one_by_now(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            async with connect(server.url, name="ada") as ada:
                created = await ada.create("multi_agent/02")
                await ada.join(created.code)
                resume = ada.resume
            await server.stop("restart", hand_over=True)
        async with serving(tmp_path, seed=2, require_token=True) as server:
            token = server.tokens.mint_role(Role.PLAYER, "p-1", seconds=60)
            client = Client(server.url, name="ada", token=token, resume=resume)
            async with client:
                assert (await client.join(created.code)).seat == "robot2"

    run(main())
