"""One token opens so many episodes at a time, over all of its connections."""

from __future__ import annotations

from pathlib import Path

from robotouille_server.auth.roles import Role
from tests.support.newcomers import hello, minted, opened
from tests.support.servers import Raw, serving
from tests.support.virtual_time import run

CREATE = {"type": "create", "task": "synchronous/01", "max_steps": 1}


async def play(connection: Raw, code: str) -> None:
    """The only step of an episode."""
    await connection.ask({"type": "join", "episode": code}, "joined")
    await connection.send({"type": "act", "seq": 1, "action": None})
    assert (await connection.expect("ended"))["outcome"]["reason"] == "step_limit"


def test_who_has_as_many_episodes_as_allowed_opens_one_when_one_ends(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with serving(tmp_path, max_episodes_per_owner=1) as server:
            token = minted(server, Role.HOST)
            async with opened(server) as first, opened(server) as second:
                for connection in (first, second):
                    await hello(connection, token=token)
                created = await first.ask(CREATE, "created")
                assert created["type"] == "created"
                for connection in (first, second):
                    assert (await connection.ask(CREATE, "created"))["code"] == "rate/episodes"
                await play(first, created["code"])
                assert (await second.ask(CREATE, "created"))["type"] == "created"
                assert (await first.ask(CREATE, "created"))["code"] == "rate/episodes"

    run(scenario())


def test_others_are_not_limited_by_it(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with serving(tmp_path, max_episodes_per_owner=1) as server:
            other = server.tokens.mint_role(Role.HOST, "p-2", seconds=3600)
            for token in (minted(server, Role.HOST), other):
                async with opened(server) as connection:
                    await hello(connection, token=token)
                    assert (await connection.ask(CREATE, "created"))["type"] == "created"
                    assert (await connection.ask(CREATE, "created"))["code"] == "rate/episodes"

    run(scenario())
