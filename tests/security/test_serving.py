"""Access to a whole server."""

from __future__ import annotations

import asyncio
import time
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from robotouille_server import Server, ServerSettings, serve
from robotouille_server.app import Surroundings
from robotouille_server.auth.keys import FileKeyring, rotate
from robotouille_server.auth.roles import Role
from robotouille_server.auth.tokens import Tokens
from robotouille_server.auth.visitors import PROBATION_FACTOR
from robotouille_server.runtime.workers import WorkerSlot
from tests.support.handshakes import (
    FORWARDED,
    ONE_COOK,
    TWO_COOKS,
    hello,
    mint_token,
    opened,
    status,
)
from tests.support.servers import crash, serving
from tests.support.virtual_time import virtual

NOW = 1_800_000_000.0
TASK = "synchronous/01_cheese_sandwich"


CREATE = {"type": "create", "task": TASK}
REQUESTS: dict[str, tuple[dict[str, Any], str]] = {
    "create": (CREATE, "created"),
    "list": ({"type": "list"}, "episodes"),
    "play": ({"type": "join"}, "joined"),
    "watch": ({"type": "join", "role": "spectator"}, "joined"),
}


async def allowed(server: Server, headers: dict[str, str], **fields: Any) -> set[str]:
    """Return the requests that a new session may send."""
    granted = set()
    for name, (request, answer) in REQUESTS.items():
        room = server.lobby.create(ONE_COOK, owner="")
        async with opened(server, **headers) as connection:
            welcome = await hello(connection, **fields)
            assert welcome["type"] == "welcome", welcome
            whole = {**request, "episode": room.code} if request["type"] == "join" else request
            got = await connection.ask(whole, answer)
            if got["type"] == answer:
                granted.add(name)
            else:
                assert got["code"] == "auth/role", got
    return granted


EVERYTHING = {"create", "list", "play", "watch"}


@virtual
async def test_only_local_programs_may_create_without_a_token(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        assert await allowed(server, {}) == EVERYTHING
        assert await allowed(server, FORWARDED) == {"play", "watch"}
        assert await allowed(server, {"Host": "kitchen.example.org"}) == {"play", "watch"}


@virtual
async def test_token_gives_its_role_from_every_address(tmp_path: Path) -> None:
    expected = {
        Role.OPERATOR: EVERYTHING,
        Role.HOST: EVERYTHING,
        Role.PLAYER: {"play", "watch"},
        Role.SPECTATOR: {"watch"},
    }
    async with serving(tmp_path, require_token=True) as server:
        for role, granted in expected.items():
            token = mint_token(server, role)
            assert await allowed(server, FORWARDED, token=token) == granted
            assert await allowed(server, {}, token=token) == granted


@virtual
async def test_strict_server_requires_a_token(tmp_path: Path) -> None:
    async with serving(tmp_path, require_token=True) as server:
        async with opened(server) as connection:
            assert (await hello(connection))["code"] == "auth/required"
            assert (await connection.ask(CREATE))["code"] == "protocol/hello"
            welcome = await hello(connection, token=mint_token(server, Role.SPECTATOR))
            assert (welcome["type"], welcome["role"]) == ("welcome", "spectator")


@virtual
async def test_name_and_limits_of_a_token_are_binding(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        mine = server.lobby.create(TWO_COOKS, owner="")
        other = server.lobby.create(TWO_COOKS, owner="")
        token = mint_token(server, Role.PLAYER, name="Zoë", episode=mine.code, seat="robot2")
        async with opened(server, **FORWARDED) as connection:
            await hello(connection, token=token, name="Mallory")
            join = {"type": "join", "episode": other.code}
            assert (await connection.ask(join))["code"] == "auth/episode"
            join = {"type": "join", "episode": mine.code, "seat": "robot1"}
            assert (await connection.ask(join))["code"] == "auth/seat"
            joined = await connection.ask({"type": "join", "episode": mine.id}, "joined")
            assert joined["seat"] == "robot2"
            snapshot = await connection.expect("snapshot")
            assert snapshot["seats"][1]["name"] == "Zoë"


@virtual
async def test_limits_of_a_token_survive_a_restart(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        mine = server.lobby.create(TWO_COOKS, owner="")
        other = server.lobby.create(TWO_COOKS, owner="")
        token = mint_token(server, Role.PLAYER, episode=mine.code, seat="robot1")
        async with opened(server, **FORWARDED) as connection:
            await hello(connection, token=token)
            join = {"type": "join", "episode": mine.code}
            joined = await connection.ask(join, "joined")
            await crash(server)
    async with serving(tmp_path, seed=2) as server:
        async with opened(server, **FORWARDED) as connection:
            assert (await hello(connection, resume=joined["resume"]))["resumed"]
            await connection.ask({"type": "leave"}, "left")
            join = {"type": "join", "episode": other.code}
            assert (await connection.ask(join, "joined")).get("code") == "auth/episode"


@virtual
async def test_keys_can_be_rotated_while_the_server_runs(tmp_path: Path) -> None:
    async with serving(tmp_path / "r", keys=tmp_path / "keys.json") as server:
        old = mint_token(server, Role.HOST)
        rotate(tmp_path / "keys.json", keep=2)
        elsewhere = Tokens(FileKeyring(tmp_path / "keys.json"), time.time)
        new = elsewhere.mint_role(Role.HOST, "x", seconds=60)
        for token in (old, new):
            async with opened(server) as connection:
                assert (await hello(connection, token=token))["type"] == "welcome"
        rotate(tmp_path / "keys.json", keep=1)
        for token in (old, new):
            async with opened(server) as connection:
                assert (await hello(connection, token=token))["code"] == "auth/invalid"


@virtual
async def test_foreign_web_pages_are_refused(tmp_path: Path) -> None:
    async with serving(tmp_path, origins="https://kitchen.example.org") as server:
        code, text = await status(server, Origin="https://evil.example")
        assert code == 403
        assert "--origins" in text
        assert (await status(server, Origin="https://kitchen.example.org"))[0] == 101
        assert (await status(server))[0] == 101


TWO_FROM_ELSEWHERE = {"max_connections_per_address": 2, "trust_proxy": "loopback"}


@virtual
async def test_connections_per_address_are_limited(tmp_path: Path) -> None:
    async with serving(tmp_path, **TWO_FROM_ELSEWHERE) as server:
        async with AsyncExitStack() as stack:
            for number in range(3):
                connection = await stack.enter_async_context(opened(server, **FORWARDED))
                answer = await hello(connection)
                if number < 2:
                    assert answer["type"] == "welcome"
            assert (answer["type"], answer["code"]) == ("bye", "rate/connections")
            assert answer["retry"] is True
            with pytest.raises(ConnectionClosed):
                await connection.receive()
            assert connection.socket.close_code == 1013
            for headers in ({"X-Forwarded-For": "203.0.113.10"}, {}):
                other = await stack.enter_async_context(opened(server, **headers))
                assert (await hello(other))["type"] == "welcome"
        await asyncio.sleep(1)
        async with opened(server, **FORWARDED) as connection:
            assert (await hello(connection))["type"] == "welcome"


@virtual
async def test_silent_connections_keep_nobody_out(tmp_path: Path) -> None:
    async with serving(tmp_path, **TWO_FROM_ELSEWHERE) as server, AsyncExitStack() as stack:
        token = mint_token(server, Role.PLAYER)
        for _ in range(2):
            anonymous = await stack.enter_async_context(opened(server, **FORWARDED))
            assert (await hello(anonymous))["type"] == "welcome"
        silent = [
            await stack.enter_async_context(opened(server, **FORWARDED))
            for _ in range(2 * PROBATION_FACTOR)
        ]
        holders = []
        for _ in range(2):
            holders.append(await stack.enter_async_context(opened(server, **FORWARDED)))
            assert (await hello(holders[-1], token=token))["type"] == "welcome"
        for connection in silent[:1]:
            bye = await connection.receive()
            assert (bye["type"], bye["code"]) == ("bye", "rate/connections")
        third = await stack.enter_async_context(opened(server, **FORWARDED))
        assert (await hello(third, token=token))["code"] == "rate/connections"
        other = await stack.enter_async_context(opened(server, **FORWARDED))
        other_token = server.tokens.mint_role(Role.PLAYER, "p-2", seconds=60)
        assert (await hello(other, token=other_token))["type"] == "welcome"


@virtual
async def test_returning_client_needs_no_second_slot(tmp_path: Path) -> None:
    """The server has not noticed yet that the first connection is dead."""
    options = {**TWO_FROM_ELSEWHERE, "max_connections_per_address": 1}
    async with serving(tmp_path, **options) as server, AsyncExitStack() as stack:
        room = server.lobby.create(TWO_COOKS, owner="")
        first = await stack.enter_async_context(opened(server, **FORWARDED))
        await hello(first)
        joined = await first.ask({"type": "join", "episode": room.code}, "joined")
        again = await stack.enter_async_context(opened(server, **FORWARDED))
        assert (await hello(again, resume=joined["resume"]))["resumed"]
        assert (await first.expect("bye"))["code"] == "session/elsewhere"
        await asyncio.sleep(1)
        third = await stack.enter_async_context(opened(server, **FORWARDED))
        assert (await hello(third))["code"] == "rate/connections"


@virtual
async def test_guesser_does_not_block_token_bearers(tmp_path: Path) -> None:
    async with serving(tmp_path, trust_proxy="loopback") as server:
        room = server.lobby.create(ONE_COOK, owner="")
        async with opened(server, **FORWARDED) as guesser:
            await hello(guesser)
            wrong = {"type": "join", "episode": "AAAAA-AAAAA"}
            codes = [(await guesser.ask(wrong))["code"] for _ in range(21)]
            assert codes[-1] == "rate/codes"
        async with opened(server, **FORWARDED) as holder:
            await hello(holder, token=mint_token(server, Role.PLAYER))
            right = {"type": "join", "episode": room.code}
            assert (await holder.ask(right, "joined"))["type"] == "joined"
            await holder.ask({"type": "leave"}, "left")
            codes = [(await holder.ask(wrong))["code"] for _ in range(21)]
            assert codes == ["episode/unknown"] * 20 + ["rate/codes"]


@virtual
async def test_wrong_codes_of_rematches_are_limited(tmp_path: Path) -> None:
    async with serving(tmp_path, trust_proxy="loopback") as server:
        room = server.lobby.create(ONE_COOK, owner="")
        async with opened(server, **FORWARDED) as guesser:
            await hello(guesser)
            guesses = [{"type": "create", "rematch": code} for code in ["AAAAA-AAAAA", room.code]]
            codes = [(await guesser.ask(guesses[n % 2]))["code"] for n in range(21)]
            assert codes == ["episode/unknown"] * 20 + ["rate/codes"]
            right = {"type": "join", "episode": room.code}
            assert (await guesser.ask(right))["code"] == "rate/codes"


@virtual
async def test_wrong_codes_are_limited(tmp_path: Path) -> None:
    async with serving(tmp_path, trust_proxy="loopback") as server:
        room = server.lobby.create(ONE_COOK, owner="")
        codes = []
        for _ in range(3):
            async with opened(server, **FORWARDED) as connection:
                await hello(connection)
                for number in range(10):
                    join = {"type": "join", "episode": f"AAAAAAAA{'ABCDEFGHJK'[number]}A"}
                    codes.append((await connection.ask(join))["code"])
        assert codes == ["episode/unknown"] * 20 + ["rate/codes"] * 10
        async with opened(server, **FORWARDED) as connection:
            await hello(connection)
            right = {"type": "join", "episode": room.code}
            assert (await connection.ask(right))["code"] == "rate/codes"
            await asyncio.sleep(60)
            assert (await connection.ask(right, "joined"))["type"] == "joined"


@virtual
async def test_metrics_are_for_this_machine_only(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        assert "robotouille_connections" in (await fetch(server, "/metrics"))
        assert "403" in (await fetch(server, "/metrics", "X-Forwarded-For: 203.0.113.9"))
        assert "403" in (await fetch(server, "/metrics", "Host: server:8765"))
    async with serving(tmp_path, metrics_from="loopback") as server:
        assert " 200 " in (await fetch(server, "/metrics", "Host: server:8765"))
        assert "403" in (await fetch(server, "/metrics", "X-Forwarded-For: 127.0.0.1"))


@pytest.mark.parametrize("path", ["/healthz", "/readyz", "/metrics", "/play"])
@virtual
async def test_only_get_is_answered(tmp_path: Path, path: str) -> None:
    async with serving(tmp_path) as server:
        for method in ("POST", "PUT", "DELETE", "HEAD"):
            answer = await fetch(server, path, method=method)
            assert answer.startswith("HTTP/1.1 405 ") and "Allow: GET" in answer


async def fetch(server: Server, path: str, *headers: str, method: str = "GET") -> str:
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    lines = [f"{method} {path} HTTP/1.1", "Host: 127.0.0.1", "Connection: close", *headers, "", ""]
    writer.write("\r\n".join(lines).encode())
    answer = await reader.read()
    writer.close()
    return answer.decode()


@pytest.mark.parametrize("role", ["player", "spectator"])
@virtual
async def test_id_is_a_wrong_code_for_participants(tmp_path: Path, role: str) -> None:
    async with serving(tmp_path, trust_proxy="loopback") as server:
        room, other = (server.lobby.create(ONE_COOK, owner="") for _ in range(2))
        join = {"type": "join", "episode": room.id, "role": role}
        tokens = [{}, {"token": mint_token(server, Role.PLAYER)}]
        tokens += [
            {"token": mint_token(server, mint, episode=other.code)}
            for mint in (Role.PLAYER, Role.HOST)
        ]
        for fields in tokens:
            async with opened(server, **FORWARDED) as stranger:
                await hello(stranger, **fields)
                unknown = await stranger.ask({**join, "episode": "0123456789abcdef"})
                answer = await stranger.ask(join)
                assert answer["code"] == unknown["code"] == "episode/unknown"
                assert (
                    answer["message"]
                    == f"no episode has the id or code {room.id!r}, or it has ended"
                )
        async with opened(server, **FORWARDED) as stranger:
            await hello(stranger, name="mallory")
            codes = [(await stranger.ask(join))["code"] for _ in range(21)]
            assert codes[-1] == "rate/codes"


@virtual
async def test_hosts_and_bearers_of_a_token_for_the_episode_join_by_id(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(ONE_COOK, owner="")
        join = {"type": "join", "episode": room.id, "role": "spectator"}
        for token in (
            mint_token(server, Role.HOST),
            mint_token(server, Role.PLAYER, episode=room.id),
            mint_token(server, Role.SPECTATOR, episode=room.code),
        ):
            async with opened(server, **FORWARDED) as connection:
                await hello(connection, token=token)
                assert (await connection.ask(join, "joined"))["code"] == room.code


@virtual
async def test_worker_does_not_redirect_participants_with_ids_only(tmp_path: Path) -> None:
    slot = WorkerSlot(index=0, count=2, first_port=9001)
    settings = ServerSettings(port=0, recordings=tmp_path)
    async with serve(settings, Surroundings(worker=slot)) as server:
        elsewhere = WorkerSlot(index=1, count=2).mark_id(7)
        join = {"type": "join", "episode": elsewhere}
        async with opened(server, **FORWARDED) as connection:
            await hello(connection)
            assert (await connection.ask(join, "moved"))["code"] == "episode/unknown"
        async with opened(server, **FORWARDED) as connection:
            await hello(connection, token=mint_token(server, Role.PLAYER, episode=elsewhere))
            assert (await connection.ask(join, "moved"))["port"] == 9002
