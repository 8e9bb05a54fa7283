"""Returning sessions are judged by the present rules."""

from __future__ import annotations

import asyncio
import gc
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille.episode import Absence, Clock
from robotouille.replay.recording import read_recording
from robotouille.replay.timeline import note_lines
from robotouille_server import Server
from robotouille_server.auth.roles import Role
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.room import Room
from tests.support.handshakes import FORWARDED, ONE_COOK, TWO_COOKS, hello, mint_token, opened
from tests.support.servers import Raw, serving
from tests.support.virtual_time import virtual

NOW = 1_800_000_000.0
HOUR = 3600.0
CREATE = {"type": "create", "task": "synchronous/01"}


def joining(room: Room, role: str = "player") -> dict[str, Any]:
    return {"type": "join", "episode": room.code, "role": role}


async def came_in(
    server: Server, room: Room, role: str = "player", *, leave: bool = False, **fields: Any
) -> str:
    """Return the resume token of a participant who has lost the connection."""
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
@virtual
async def test_returning_spectators_respect_the_limit(
    tmp_path: Path, restart: bool, leave: bool
) -> None:
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(serving(tmp_path, max_spectators=2))
        room = server.lobby.create(TWO_COOKS, owner="")
        old = [await came_in(server, room, "spectator", leave=leave) for _ in range(6)]
        if restart:
            await server.stop("restart", hand_over=True)
            server = await stack.enter_async_context(serving(tmp_path, seed=2, max_spectators=2))
            room = server.lobby.find(room.code)
        for token in old:
            connection = await stack.enter_async_context(opened(server))
            answer = await hello(connection, resume=token)
            if answer["type"] == "error":
                assert answer["code"] == "auth/expired"
                await hello(connection)
                full = room.spectators == 2
                answer = await connection.ask(joining(room, "spectator"), "joined")
                assert answer["type"] == ("error" if full else "joined")
            else:
                assert not restart
            assert room.spectators <= 2
        assert room.spectators == 2


@virtual
async def test_ban_survives_a_restart_and_covers_all_sessions(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(TWO_COOKS, owner="")
        token = mint_token(server, Role.PLAYER)
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


@virtual
async def test_removal_covers_all_sessions_of_a_participant(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(TWO_COOKS, owner="")
        token = mint_token(server, Role.PLAYER)
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


@virtual
async def test_strict_server_refuses_old_anonymous_sessions(
    tmp_path: Path,
) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(TWO_COOKS, owner="")
        anonymous = await came_in(server, room)
        bearer = await came_in(server, room, token=mint_token(server, Role.PLAYER))
        await server.stop("restart", hand_over=True)
    async with serving(tmp_path, seed=2, require_token=True) as server:
        async with opened(server) as connection:
            refused = await hello(connection, resume=anonymous)
            assert (refused["code"], refused["field"]) == ("auth/required", "resume")
            assert (await hello(connection, resume=bearer))["resumed"]
            assert (await connection.expect("joined"))["seat"] == "robot2"


@virtual
async def test_anonymous_session_gets_the_role_of_its_address(tmp_path: Path) -> None:
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


@virtual
async def test_seat_outlives_the_role_token(
    tmp_path: Path,
) -> None:
    now = [NOW]
    async with serving(tmp_path, require_token=True, wall=lambda: now[0]) as server:
        room = server.lobby.create(TWO_COOKS.model_copy(update={"grace": 86400.0}), owner="")
        token = mint_token(server, Role.PLAYER, seconds=HOUR)
        seated = await came_in(server, room, token=token)
        watched = await came_in(server, room, "spectator", token=token)
        now[0] += 2 * HOUR
        async with opened(server) as one, opened(server) as two:
            assert (await hello(one, resume=seated))["resumed"]
            assert (await hello(two, resume=watched))["code"] == "auth/expired"


SCOPED: dict[Role, dict[str, str]] = {
    Role.OPERATOR: {"create": "auth/episode", "list": "", "play": "", "watch": "", "say": ""},
    Role.HOST: {"create": "auth/episode", "list": "", "play": "", "watch": "", "say": ""},
    Role.PLAYER: {"create": "auth/role", "list": "auth/role", "play": "", "watch": "", "say": ""},
    Role.SPECTATOR: {
        "create": "auth/role", "list": "auth/role", "play": "auth/role", "watch": "",
        "say": "auth/role",
    },
}  # fmt: skip
"""Code of the answer to a token for one episode, by role; empty if the role may send it."""


async def code_of(connection: Raw, request: dict[str, Any], answer: str) -> str:
    await connection.send(request)
    got = await connection.expect(answer, "error")
    return str(got["code"]) if got["type"] == "error" else ""


@pytest.mark.parametrize("role", Role)
@virtual
async def test_token_for_one_episode_is_checked_in_every_message(
    tmp_path: Path, role: Role
) -> None:
    async with serving(tmp_path) as server:
        mine, other = (server.lobby.create(ONE_COOK, owner="") for _ in range(2))
        for only in (mine.code, mine.id, mine.code.replace("-", "").lower()):
            async with opened(server) as connection:
                await hello(connection, token=mint_token(server, role, episode=only))
                expected = SCOPED[role]
                assert await code_of(connection, CREATE, "created") == expected["create"]
                if not expected["list"]:
                    listed = await connection.ask({"type": "list"}, "episodes")
                    assert [row["code"] for row in listed["episodes"]] == [mine.code]
                for name, part in (("play", "player"), ("watch", "spectator")):
                    code = await code_of(connection, joining(other, part), "joined")
                    assert code == (expected[name] or "auth/episode")
                    assert (
                        await code_of(connection, joining(mine, part), "joined") == expected[name]
                    )
                    if not expected[name]:
                        say = {"type": "say", "text": "x"}
                        assert await code_of(connection, say, "said") == expected["say"]
                        await connection.ask({"type": "leave"}, "left")
        assert other.members == []
        assert len(server.lobby.rooms) == 2


@virtual
async def test_codes_cannot_be_guessed_with_a_limited_token(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        mine, other = (server.lobby.create(ONE_COOK, owner="") for _ in range(2))
        token = mint_token(server, Role.PLAYER, episode=mine.code)
        async with opened(server, **FORWARDED) as connection:
            await hello(connection, token=token)
            codes = [await code_of(connection, joining(other), "joined") for _ in range(21)]
            assert codes == ["auth/episode"] * 20 + ["rate/codes"]


@virtual
async def test_memory_for_absent_spectators_is_bounded(tmp_path: Path) -> None:
    """A client that joins and disconnects in a loop leaves few sessions, for any grace."""
    long = TWO_COOKS.model_copy(update={"grace": 86_400.0})
    async with serving(tmp_path, max_spectators=3, max_connections_per_address=99) as server:
        room = server.lobby.create(long, owner="")
        async with AsyncExitStack() as stack:
            for _ in range(5):
                for _ in range(3):
                    connection = await stack.enter_async_context(opened(server, **FORWARDED))
                    await hello(connection)
                    await connection.ask(joining(room, "spectator"), "joined")
                await stack.aclose()
        for _ in range(20):
            await came_in(server, room, "spectator")
        gc.collect()
        kept = [one for one in gc.get_objects() if isinstance(one, Session) and one.room is room]
        assert len(room.members) == len(kept) <= 2 * 3
        everywhere = [one for one in gc.get_objects() if isinstance(one, Session)]
        assert len(everywhere) == len(server.sessions.by_id) <= 2 * 3


def seat_token(server: Server, room: Room, **limits: Any) -> str:
    return mint_token(server, Role.PLAYER, **{"episode": room.code, "seat": "robot1", **limits})


async def joined_with(connection: Raw, room: Room, token: str, **fields: Any) -> dict[str, Any]:
    await hello(connection, token=token)
    return await connection.ask({**joining(room), **fields}, "joined")


@pytest.mark.parametrize("limits", [{}, {"seat": ""}, {"role": Role.HOST}])
@pytest.mark.parametrize("closed", [False, True])
@virtual
async def test_token_of_an_episode_brings_its_participant_back(
    tmp_path: Path, limits: dict[str, Any], closed: bool
) -> None:
    """Another device, or a browser without its state, has only the role token."""
    async with serving(tmp_path) as server, opened(server) as first, opened(server) as second:
        room = server.lobby.create(TWO_COOKS, owner="")
        options = {"role": Role.PLAYER, "seat": "robot1", **limits}
        token = server.tokens.mint_role(subject="p-1", seconds=60, episode=room.code, **options)
        before = await joined_with(first, room, token)
        await first.ask({"type": "act", "seq": 5, "action": "?"}, "rejected")
        if closed:
            await first.socket.close()
            while room.episode.seats["robot1"].present:
                await asyncio.sleep(0.1)
        after = await joined_with(second, room, token)
        assert (after["seat"], after["name"]) == (before["seat"], before["name"])
        if not closed:
            assert (await first.expect("bye"))["code"] == "session/elsewhere"
        assert [session.player for session in room.members] == ["robot1"]
        assert room.episode.seats["robot1"].present
        async with opened(server) as late:
            answer = await hello(late, resume=before["resume"])
            # A program that stays open elsewhere must not take the seat back by itself.
            assert answer.get("code") == ("auth/expired" if not closed else None)
        assert [session.player for session in room.members] == ["robot1"]
        assert room.episode.seats["robot1"].present


@virtual
async def test_token_brings_back_its_own_participant_only(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, opened(server) as first:
        room = server.lobby.create(TWO_COOKS, owner="")
        await joined_with(first, room, seat_token(server, room))
        others = {
            "another subject": server.tokens.mint_role(
                Role.PLAYER, "p-2", seconds=60, episode=room.code, seat="robot1"
            ),
            "a token for all episodes": mint_token(server, Role.PLAYER),
        }
        for why, token in others.items():
            async with opened(server) as other:
                answer = await joined_with(other, room, token, seat="robot1")
                assert answer["code"] == "seat/taken", why
        async with opened(server) as watcher:
            answer = await joined_with(watcher, room, seat_token(server, room), role="spectator")
            assert answer["role"] == "spectator"
        assert room.episode.seats["robot1"].present


@virtual
async def test_used_token_for_one_session_does_not_bring_its_participant_back(
    tmp_path: Path,
) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(TWO_COOKS, owner="")
        once = seat_token(server, room, once=True)
        async with opened(server) as first:
            await joined_with(first, room, once)
        async with opened(server) as second:
            assert (await hello(second, token=once))["code"] == "auth/used"
            new = await joined_with(second, room, seat_token(server, room, once=True))
            assert new["seat"] == "robot1"


@virtual
async def test_taken_over_seat_survives_a_restart(tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(serving(tmp_path))
        alone = ONE_COOK.model_copy(update={"absence": Absence.PAUSE, "clock": Clock.LOCKSTEP})
        room = server.lobby.create(alone, owner="")
        token = seat_token(server, room, seat="")
        for seq in (3, 4):
            async with opened(server) as connection:
                assert (await joined_with(connection, room, token))["type"] == "joined"
                act = {"type": "act", "seq": seq, "action": "?"}
                answer = await connection.ask(act, "rejected")
                assert answer.get("code", "") != "action/stale"
                resume = (await connection.ask({"type": "resync"}, "snapshot"))["seq"]
                assert resume == seq
        before = room.episode.seats["robot1"]
        assert before.seq == 4
        await server.stop("restart", hand_over=True)
        server = await stack.enter_async_context(serving(tmp_path, seed=2))
        room = server.lobby.find(room.code)
        after = room.episode.seats["robot1"]
        same = ("session", "participant", "name", "seq", "kind", "generation", "answer")
        assert [getattr(after, name) for name in same] == [getattr(before, name) for name in same]
        async with opened(server) as connection:
            joined = await joined_with(connection, room, seat_token(server, room, seat=""))
            assert (joined["seat"], joined["seq"]) == ("robot1", 4)
            assert room.episode.running
        room.abort("over")
        await server.lobby.closed()
        recording = read_recording(next(tmp_path.glob("*.rbt")))
        assert recording.verify().ok
        words = " ".join(note_lines(recording))
        assert (words.count("takes robot1"), words.count("is back")) == (1, 2)
