"""Whoever comes back with an old token is judged by the rules that hold now."""

from __future__ import annotations

from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille_server import Server
from robotouille_server.auth.roles import Role
from robotouille_server.rooms.room import Room
from robotouille_server.rooms.session import Session
from tests.support.newcomers import FORWARDED, ONE_COOK, TWO_COOKS, hello, minted, opened
from tests.support.servers import Raw, serving
from tests.support.virtual_time import run

NOW = 1_800_000_000.0
HOUR = 3600.0
CREATE = {"type": "create", "task": "synchronous/01"}


def joining(room: Room, role: str = "player") -> dict[str, Any]:
    return {"type": "join", "episode": room.code, "role": role}


async def came_in(
    server: Server, room: Room, role: str = "player", *, leave: bool = False, **fields: Any
) -> str:
    """The resume token of somebody who was in a room, and whose line is lost now."""
    async with opened(server, **FORWARDED) as connection:
        await hello(connection, **fields)
        joined = await connection.ask(joining(room, role), "joined")
        assert joined["type"] == "joined", joined
        if leave:
            await connection.ask({"type": "leave"}, "left")
    return str(joined["resume"])


def member(room: Room, participant: str) -> Session:
    return next(session for session in room.members if session.participant == participant)


@pytest.mark.parametrize("restart", [False, True])
@pytest.mark.parametrize("leave", [False, True])
def test_spectators_of_old_are_no_more_than_there_may_be(
    tmp_path: Path, restart: bool, leave: bool
) -> None:
    """Nor those who come in the meantime; who finds no place can say hello anew."""

    async def main() -> None:
        async with AsyncExitStack() as stack:
            server = await stack.enter_async_context(serving(tmp_path, max_spectators=2))
            room = server.lobby.create(TWO_COOKS, owner="")
            old = [await came_in(server, room, "spectator", leave=leave) for _ in range(6)]
            if restart:
                await server.stop("restart", hand_over=True)
                server = await stack.enter_async_context(
                    serving(tmp_path, seed=2, max_spectators=2)
                )
                room = server.lobby.find(room.code)
            watching = 0
            for token in old:
                connection = await stack.enter_async_context(opened(server))
                answer = await hello(connection, resume=token)
                watching += answer["type"] == "welcome" and room.spectators > watching
                assert room.spectators <= 2
                if answer["type"] == "error":
                    assert answer["code"] == "auth/expired"
                    await hello(connection)
                    if room.spectators == 2:
                        refused = await connection.ask(joining(room, "spectator"), "joined")
                        assert refused["code"] == "episode/full"
            assert watching == min(2, room.spectators)

    run(main())


def test_a_ban_outlives_the_server_and_covers_every_session(tmp_path: Path) -> None:
    """One who watched before, and played later under another session of the same token."""

    async def main() -> None:
        async with serving(tmp_path) as server:
            room = server.lobby.create(TWO_COOKS, owner="")
            token = minted(server, Role.PLAYER)
            watched = await came_in(server, room, "spectator", leave=True, token=token)
            seated = await came_in(server, room, token=token)
            stranger = await came_in(server, room)
            room.kick(member(room, "p-1"), "rude")
            await server.stop("restart", hand_over=True)
        async with serving(tmp_path, seed=2) as server:
            room = server.lobby.find(room.code)
            async with opened(server) as eve:
                for old in (watched, seated):
                    assert (await hello(eve, resume=old))["code"] == "auth/expired"
                assert (await hello(eve, token=token))["type"] == "welcome"
                for role in ("player", "spectator"):
                    answer = await eve.ask(joining(room, role), "joined")
                    assert answer["code"] == "episode/banned"
                assert room.members == []
            async with opened(server) as bob:
                assert (await hello(bob, resume=stranger))["resumed"]
                assert (await bob.expect("joined"))["seat"] == "robot2"

    run(main())


def test_who_is_sent_out_goes_with_all_of_their_sessions(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            room = server.lobby.create(TWO_COOKS, owner="")
            token = minted(server, Role.PLAYER)
            async with opened(server) as one, opened(server) as two, opened(server) as other:
                for connection, fields in ((one, {"token": token}), (two, {"token": token})):
                    await hello(connection, **fields)
                await hello(other)
                await one.ask(joining(room), "joined")
                await two.ask(joining(room, "spectator"), "joined")
                await other.ask(joining(room), "joined")
                room.kick(member(room, "p-1"), "rude")
                for connection in (one, two):
                    assert (await connection.expect("left"))["reason"] == "rude"
                assert [session.player for session in room.members] == ["robot2"]

    run(main())


def test_a_server_that_asks_for_tokens_now_takes_no_anonymous_session_of_old(
    tmp_path: Path,
) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            room = server.lobby.create(TWO_COOKS, owner="")
            anonymous = await came_in(server, room)
            bearer = await came_in(server, room, token=minted(server, Role.PLAYER))
            await server.stop("restart", hand_over=True)
        async with serving(tmp_path, seed=2, require_token=True) as server:
            async with opened(server) as connection:
                refused = await hello(connection, resume=anonymous)
                assert (refused["code"], refused["field"]) == ("auth/required", "resume")
                assert (await hello(connection, resume=bearer))["resumed"]
                assert (await connection.expect("joined"))["seat"] == "robot2"

    run(main())


def test_an_anonymous_session_may_what_a_newcomer_from_there_may(tmp_path: Path) -> None:
    """A host by being on this machine is none elsewhere."""

    async def main() -> None:
        async with serving(tmp_path) as server:
            async with opened(server) as here:
                assert (await hello(here))["role"] == "host"
                created = await here.ask({**CREATE, "grace": 86400.0}, "created")
                joined = await here.ask({"type": "join", "episode": created["code"]}, "joined")
            token = joined["resume"]
            for headers, role in ((FORWARDED, "player"), ({}, "host"), (FORWARDED, "player")):
                async with opened(server, **headers) as again:
                    welcome = await hello(again, resume=token)
                    assert (welcome["resumed"], welcome["role"]) == (True, role)
                    assert (await again.expect("joined"))["seat"] == "robot1"
                    answer = await again.ask(CREATE, "created")
                    assert answer["type"] == ("created" if role == "host" else "error")
                    token = welcome["resume"]

    run(main())


def test_who_has_a_seat_keeps_it_when_the_role_token_ends_and_others_do_not(
    tmp_path: Path,
) -> None:
    now = [NOW]

    async def main() -> None:
        async with serving(tmp_path, require_token=True, wall=lambda: now[0]) as server:
            room = server.lobby.create(TWO_COOKS.model_copy(update={"grace": 86400.0}), owner="")
            token = minted(server, Role.PLAYER, seconds=HOUR)
            seated = await came_in(server, room, token=token)
            watched = await came_in(server, room, "spectator", token=token)
            now[0] += 2 * HOUR
            async with opened(server) as one, opened(server) as two:
                assert (await hello(one, resume=seated))["resumed"]
                assert (await hello(two, resume=watched))["code"] == "auth/expired"

    run(main())


SCOPED: dict[Role, dict[str, str]] = {
    Role.OPERATOR: {"create": "auth/episode", "list": "", "play": "", "watch": "", "say": ""},
    Role.HOST: {"create": "auth/episode", "list": "", "play": "", "watch": "", "say": ""},
    Role.PLAYER: {"create": "auth/role", "list": "auth/role", "play": "", "watch": "", "say": ""},
    Role.SPECTATOR: {
        "create": "auth/role", "list": "auth/role", "play": "auth/role", "watch": "",
        "say": "auth/role",
    },
}  # fmt: skip
"""What a token for one episode is answered there, by role; empty if it may."""


async def code_of(connection: Raw, request: dict[str, Any], answer: str) -> str:
    await connection.send(request)
    got = await connection.expect(answer, "error")
    return str(got["code"]) if got["type"] == "error" else ""


@pytest.mark.parametrize("role", Role)
def test_a_token_for_one_episode_is_for_that_one_in_every_message(
    tmp_path: Path, role: Role
) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            mine, other = (server.lobby.create(ONE_COOK, owner="") for _ in range(2))
            for only in (mine.code, mine.id, mine.code.replace("-", "").lower()):
                async with opened(server) as connection:
                    await hello(connection, token=minted(server, role, episode=only))
                    expected = SCOPED[role]
                    assert await code_of(connection, CREATE, "created") == expected["create"]
                    if not expected["list"]:
                        listed = await connection.ask({"type": "list"}, "episodes")
                        assert [row["code"] for row in listed["episodes"]] == [mine.code]
                    for name, part in (("play", "player"), ("watch", "spectator")):
                        code = await code_of(connection, joining(other, part), "joined")
                        assert code == (expected[name] or "auth/episode")
                        assert (
                            await code_of(connection, joining(mine, part), "joined")
                            == expected[name]
                        )
                        if not expected[name]:
                            say = {"type": "say", "text": "x"}
                            assert await code_of(connection, say, "said") == expected["say"]
                            await connection.ask({"type": "leave"}, "left")
            assert other.members == []
            assert len(server.lobby.rooms) == 2

    run(main())


def test_codes_cannot_be_guessed_with_a_token_for_another_episode(tmp_path: Path) -> None:
    """That a code exists is nothing to find out by trying."""

    async def main() -> None:
        async with serving(tmp_path) as server:
            mine, other = (server.lobby.create(ONE_COOK, owner="") for _ in range(2))
            token = minted(server, Role.PLAYER, episode=mine.code)
            async with opened(server, **FORWARDED) as connection:
                await hello(connection, token=token)
                codes = [await code_of(connection, joining(other), "joined") for _ in range(21)]
                assert codes == ["auth/episode"] * 20 + ["rate/codes"]

    run(main())
