"""MCP sessions and connections of several clients, some of which are hostile."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from robotouille_client.client import Client
from robotouille_client.mcp_server import http, sessions
from robotouille_client.mcp_server.http import PATH, HttpService, http_app, listening_socket
from robotouille_client.mcp_server.limits import MAX_BODY_VALUES
from robotouille_client.mcp_server.open_games import Caller, OpenGames
from robotouille_client.mcp_server.server import mcp_server
from robotouille_client.mcp_server.turns import TURNS_AT_ONCE
from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.auth.revocation import REVOKED_FILE, revoke
from tests.support.mcp_agent import over, with_bearer
from tests.support.servers import serving

HELLO = {
    "jsonrpc": "2.0",
    "id": 1,
    "method": "initialize",
    "params": {
        "protocolVersion": "2025-06-18",
        "capabilities": {},
        "clientInfo": {"name": "ada", "version": "1"},
    },
}
PING = {"jsonrpc": "2.0", "id": 2, "method": "ping"}
ACCEPT = {"accept": "application/json, text/event-stream"}
MADE_UP = "made-up"
STATELESS = "2026-07-28"
CLIENT = {
    "protocolVersion": STATELESS,
    "clientCapabilities": {},
    "clientInfo": {"name": "ada", "version": "1"},
}


class Service:
    """MCP server over HTTP, and its game server."""

    def __init__(self, server: Server, games: OpenGames, url: str, raw: httpx.AsyncClient) -> None:
        self.server = server
        self.games = games
        self.url = url
        self._raw = raw

    def token(self, subject: str) -> str:
        return self.server.tokens.mint_role(Role.HOST, subject, seconds=3600)

    def revoke(self, token: str) -> None:
        grant = self.server.tokens.check_role(token)
        path = self.server.settings.state_folder / REVOKED_FILE
        revoke(path, [grant.token_id], grant.expires, 0.0)

    async def send(
        self, content: object, token: str = "", session: str = "", method: str = "POST", **more: str
    ) -> httpx.Response:
        headers = {**ACCEPT, "mcp-session-id": session, "authorization": f"Bearer {token}", **more}
        given = {name: value for name, value in headers.items() if value.strip() != "Bearer"}
        given = {name: value for name, value in given.items() if value}
        return await self._raw.request(method, self.url, json=content, headers=given)

    @asynccontextmanager
    async def listening(self, token: str) -> AsyncIterator[None]:
        """Hold a call of a session of its own in progress."""
        headers = {**ACCEPT, "mcp-session-id": await self.opened(token)}
        headers["authorization"] = f"Bearer {token}"
        async with self._raw.stream("GET", self.url, headers=headers) as answer:
            assert answer.status_code == 200
            yield

    async def stateless(self, token: str, subject: str = "guide") -> httpx.Response:
        """Read a resource without a session."""
        uri = f"robotouille://{subject}"
        meta = {f"io.modelcontextprotocol/{name}": value for name, value in CLIENT.items()}
        request = {**PING, "method": "resources/read", "params": {"uri": uri, "_meta": meta}}
        headers = {"mcp-protocol-version": STATELESS, "mcp-method": "resources/read"}
        return await self.send(request, token, **headers, **{"mcp-name": uri})

    async def opened(self, token: str = "") -> str:
        """Open a session and return its id."""
        answer = await self.send(HELLO, token)
        assert answer.status_code == 200, answer.text
        return answer.headers["mcp-session-id"]

    async def alive(self, session: str, token: str = "") -> bool:
        return (await self.send(PING, token, session)).status_code == 200


@asynccontextmanager
async def service(folder: Path, **options: Any) -> AsyncIterator[Service]:
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(serving(folder, **options))
        raw = await stack.enter_async_context(
            httpx.AsyncClient(trust_env=False, timeout=30, verify=False)
        )
        games = OpenGames(server.url)
        app = http_app(mcp_server(lambda: games), games, idle_seconds=600)
        with listening_socket("127.0.0.1", 0) as listening:
            running = HttpService(app, games)
            task = asyncio.create_task(running.serve(sockets=[listening]))
            url = f"http://127.0.0.1:{listening.getsockname()[1]}{PATH}"
            yield Service(server, games, url, raw)
            await raw.aclose()
            running.should_exit = True
            await task


async def test_made_up_tokens_open_no_session(tmp_path: Path) -> None:
    async with service(tmp_path) as mcp:
        for _ in range(5):
            answer = await mcp.send(HELLO, MADE_UP)
            assert answer.status_code == 401
            assert answer.headers["www-authenticate"].startswith("Bearer")
            assert "mcp-session-id" not in answer.headers
        ada = mcp.token("ada")
        assert await mcp.alive(await mcp.opened(ada), ada)


async def test_requests_without_a_session_need_a_token_of_the_game_server(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with service(tmp_path) as mcp:
        ada = mcp.token("ada")
        for _ in range(2):
            assert (await mcp.stateless(MADE_UP)).status_code == 401
            assert (await mcp.stateless(ada)).status_code == 200
        mcp.revoke(ada)
        monkeypatch.setattr(sessions, "RECHECK_SECONDS", 0.0)
        assert (await mcp.stateless(ada)).status_code == 401


async def test_accepted_token_is_checked_once_in_a_while(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with service(tmp_path) as mcp:
        ada = mcp.token("ada")
        session = await mcp.opened(ada)
        url, mcp.games.url = mcp.games.url, "ws://127.0.0.1:9"
        assert (await mcp.stateless(ada)).status_code == 200
        assert (await mcp.stateless(mcp.token("bob"))).status_code == 503
        monkeypatch.setattr(sessions, "RECHECK_SECONDS", 0.0)
        assert (await mcp.stateless(ada)).status_code == 200
        monkeypatch.setattr(sessions, "MAX_ACCEPTED", 0)
        mcp.games.url = url
        assert await mcp.alive(session, ada)
        mcp.games.url = "ws://127.0.0.1:9"
        assert (await mcp.stateless(ada)).status_code == 503


async def test_token_that_has_expired_plays_its_game_to_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "RECHECK_SECONDS", 0.0)
    wall = [1_800_000_000.0]
    async with service(tmp_path, wall=lambda: wall[0]) as mcp:
        ada, bob = mcp.token("ada"), mcp.token("bob")
        caller = Caller(ada, alone=False)
        async with mcp.games.visit(caller) as client:
            code = (await client.create("synchronous/01")).code
        await mcp.games.join(caller, code, None, "player")
        for token in (ada, bob):
            assert (await mcp.stateless(token)).status_code == 200
        wall[0] += 7200
        assert (await mcp.stateless(ada)).status_code == 200
        assert (await mcp.stateless(bob)).status_code == 401
        await mcp.games.close_all()
        assert (await mcp.stateless(ada)).status_code == 401


async def test_token_that_is_too_long_is_refused_without_repeating_it(tmp_path: Path) -> None:
    async with service(tmp_path) as mcp:
        answer = await mcp.send(HELLO, "x" * 2001)
        assert answer.status_code == 401
        assert "xxxx" not in answer.text


async def test_session_works_with_its_own_token_only(tmp_path: Path) -> None:
    async with service(tmp_path) as mcp:
        ada, eve = mcp.token("ada"), mcp.token("eve")
        session = await mcp.opened(ada)
        for token in (eve, MADE_UP, ""):
            assert (await mcp.send(PING, token, session)).status_code == 404
            assert (await mcp.send(None, token, session, "DELETE")).status_code == 404
        assert await mcp.alive(session, ada)
        assert (await mcp.send(None, ada, session, "DELETE")).status_code == 200
        assert not await mcp.alive(session, ada)


@pytest.mark.slow
async def test_revoked_token_ends_the_session_and_frees_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "RECHECK_SECONDS", 0.0)
    monkeypatch.setattr(sessions, "MAX_SESSIONS", 1)
    async with service(tmp_path) as mcp:
        ada, eve = mcp.token("ada"), mcp.token("eve")
        async with with_bearer(mcp.url, eve, "legacy") as playing:
            await playing.call("join", episode=await playing.opened("synchronous/01"))
            (session,) = mcp.games.sessions()
            assert session is not None
            # A session with a game gives way to nobody.
            assert (await mcp.send(HELLO, ada)).status_code == 503
            mcp.revoke(eve)
            answer = await mcp.send(PING, eve, session)
            assert answer.status_code == 401
            assert "revoked" in answer.json()["error_description"]
            assert len(mcp.games) == 0
            assert (await mcp.send(PING, eve, session)).status_code == 404
            assert await mcp.alive(await mcp.opened(ada), ada)


async def test_session_goes_on_without_its_game_server(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "RECHECK_SECONDS", 0.0)
    async with service(tmp_path) as mcp:
        ada = mcp.token("ada")
        session = await mcp.opened(ada)
        mcp.games.url = "ws://127.0.0.1:9"
        assert await mcp.alive(session, ada)


async def test_strangers_cannot_end_the_games_of_a_session(tmp_path: Path) -> None:
    async with service(tmp_path) as mcp:
        token = mcp.token("ada")
        async with with_bearer(mcp.url, token, "legacy") as ada:
            await ada.call("join", episode=await ada.opened("synchronous/01"))
            (session,) = mcp.games.sessions()
            assert session is not None
            assert (await mcp.send(None, MADE_UP, session, "DELETE")).status_code == 404
            assert len(mcp.games) == 1
        assert len(mcp.games) == 0


@pytest.mark.slow
async def test_oldest_session_without_a_game_gives_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "MAX_SESSIONS", 3)
    async with service(tmp_path) as mcp, over(mcp.url, "legacy") as playing:
        view = await playing.call("join", episode=await playing.opened("synchronous/01"))
        first, second = await mcp.opened(), await mcp.opened()
        third = await mcp.opened()
        assert [await mcp.alive(each) for each in (first, second, third)] == [False, True, True]
        await playing.call("observe", game=view["game"])


async def test_one_token_cannot_displace_the_sessions_of_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "MAX_SESSIONS_OF_TOKEN", 2)
    async with service(tmp_path) as mcp:
        ada, eve = mcp.token("ada"), mcp.token("eve")
        session = await mcp.opened(ada)
        many = [await mcp.opened(eve) for _ in range(4)]
        assert await mcp.alive(session, ada)
        assert [await mcp.alive(each, eve) for each in many] == [False, False, True, True]


async def test_token_at_its_own_limit_displaces_no_neighbour(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "MAX_SESSIONS_OF_TOKEN", 2)
    monkeypatch.setattr(sessions, "MAX_SESSIONS_OF_ADDRESS", 3)
    monkeypatch.setattr(sessions, "address_group", lambda address: "here")
    async with service(tmp_path) as mcp:
        ada, eve = mcp.token("ada"), mcp.token("eve")
        session = await mcp.opened(ada)
        many = [await mcp.opened(eve) for _ in range(3)]
        assert await mcp.alive(session, ada)
        assert [await mcp.alive(each, eve) for each in many] == [False, True, True]


async def test_one_token_cannot_use_up_the_connections_of_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "MAX_REQUESTS_OF_TOKEN", 2)
    async with service(tmp_path) as mcp:
        ada, eve = mcp.token("ada"), mcp.token("eve")
        session, other = await mcp.opened(ada), await mcp.opened(eve)
        async with mcp.listening(eve), mcp.listening(eve):
            answer = await mcp.send(PING, eve, other)
            assert (answer.status_code, "in progress" in answer.text) == (503, True)
            assert await mcp.alive(session, ada)


async def test_all_spellings_of_a_link_count_as_one_token(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "MAX_REQUESTS_OF_TOKEN", 2)
    async with service(tmp_path) as mcp:
        link = mcp.server.tokens.mint_link("eve", seconds=3600, code="KQXZB-MHTWA")
        code, _, rest = link.partition(".")
        lower, plain = f"{code.lower()}.{rest}", f"{code.replace('-', '')}.{rest}"
        session = await mcp.opened(link)
        assert await mcp.alive(session, plain)
        async with mcp.listening(link), mcp.listening(lower):
            answer = await mcp.send(PING, plain, session)
            assert (answer.status_code, "in progress" in answer.text) == (503, True)


async def test_unknown_tokens_beyond_their_limit_are_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "MAX_NEWCOMERS", 0)
    async with service(tmp_path) as mcp:
        answer = await mcp.send(HELLO, mcp.token("ada"))
        assert (answer.status_code, "unknown tokens" in answer.text) == (503, True)
        assert await mcp.alive(await mcp.opened())


@pytest.mark.slow
async def test_calls_that_wait_for_the_game_take_no_turns(tmp_path: Path) -> None:
    async with service(tmp_path) as mcp:
        token = mcp.token("ada")
        async with AsyncExitStack() as stack:
            agents = [
                await stack.enter_async_context(with_bearer(mcp.url, token))
                for _ in range(2 * TURNS_AT_ONCE)
            ]
            code = await agents[0].opened("multi_agent/01")
            views = [await a.call("join", episode=code, role="spectator") for a in agents]
            waiting = [
                asyncio.create_task(a.call("wait", game=v["game"], timeout_seconds=60))
                for a, v in zip(agents, views, strict=True)
            ]
            while sum(g.calls for g in mcp.games._games.values()) < len(agents):
                await asyncio.sleep(0)
            assert await mcp.alive(await mcp.opened(token), token)
            await mcp.games.close_all()
            await asyncio.gather(*waiting)


async def test_event_streams_take_no_turns(tmp_path: Path) -> None:
    async with service(tmp_path) as mcp, AsyncExitStack() as stack:
        ada = mcp.token("ada")
        for _ in range(2 * TURNS_AT_ONCE):
            await stack.enter_async_context(mcp.listening(ada))
        assert await mcp.alive(await mcp.opened(ada), ada)


async def test_requests_with_unchecked_tokens_displace_no_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "MAX_SESSIONS", 2)
    async with service(tmp_path) as mcp:
        visit, waiting, checked = mcp.games.visit, asyncio.Semaphore(0), asyncio.Event()

        @asynccontextmanager
        async def slow_visit(caller: Caller) -> AsyncIterator[Client]:
            if caller.token == MADE_UP:
                waiting.release()
                await checked.wait()
            async with visit(caller) as client:
                yield client

        monkeypatch.setattr(mcp.games, "visit", slow_visit)
        ada, bob = mcp.token("ada"), mcp.token("bob")
        session = await mcp.opened(ada)
        strangers = [asyncio.create_task(mcp.send(HELLO, MADE_UP)) for _ in range(3)]
        for _ in strangers:
            await waiting.acquire()
        await mcp.opened(bob)
        assert await mcp.alive(session, ada)
        checked.set()
        assert {(await stranger).status_code for stranger in strangers} == {401}


@pytest.mark.slow
async def test_tokens_of_open_sessions_are_checked_a_few_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "CHECKS_AT_ONCE", 2)
    monkeypatch.setattr(sessions, "RECHECK_SECONDS", 0.0)
    async with service(tmp_path) as mcp:
        visit, checks = mcp.games.visit, Counter[str]()

        @asynccontextmanager
        async def counted_visit(caller: Caller) -> AsyncIterator[Client]:
            checks["now"] += 1
            checks["most"] = max(checks["most"], checks["now"])
            async with visit(caller) as client:
                yield client
            checks["now"] -= 1

        tokens = [mcp.token(f"p-{number}") for number in range(8)]
        opened = [(await mcp.opened(token), token) for token in tokens]
        monkeypatch.setattr(mcp.games, "visit", counted_visit)
        assert all(await asyncio.gather(*(mcp.alive(*each) for each in opened)))
        assert checks["most"] == 2


async def test_checks_of_made_up_tokens_do_not_delay_an_open_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "CHECKS_AT_ONCE", 1)
    monkeypatch.setattr(sessions, "RECHECK_SECONDS", 0.0)
    async with service(tmp_path) as mcp:
        visit, checking, checked = mcp.games.visit, asyncio.Event(), asyncio.Event()

        @asynccontextmanager
        async def slow_visit(caller: Caller) -> AsyncIterator[Client]:
            if caller.token == MADE_UP:
                checking.set()
                await checked.wait()
            async with visit(caller) as client:
                yield client

        ada = mcp.token("ada")
        session = await mcp.opened(ada)
        monkeypatch.setattr(mcp.games, "visit", slow_visit)
        stranger = asyncio.create_task(mcp.send(HELLO, MADE_UP))
        await checking.wait()
        assert await mcp.alive(session, ada)
        checked.set()
        assert (await stranger).status_code == 401


async def test_unreachable_game_server_is_reported(tmp_path: Path) -> None:
    async with service(tmp_path) as mcp:
        mcp.games.url = "ws://127.0.0.1:9"
        answer = await mcp.send(HELLO, MADE_UP)
        assert answer.status_code == 503
        assert "cannot check the token" in answer.json()["error"]


async def test_silent_connections_give_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http, "MAX_CONNECTIONS", 4)
    async with service(tmp_path) as mcp:
        address = httpx.URL(mcp.url)
        silent = [await asyncio.open_connection(address.host, address.port) for _ in range(6)]
        assert await mcp.alive(await mcp.opened())
        assert await silent[0][0].read() == b""
        for _, writer in silent:
            writer.close()


async def test_connections_of_an_address_displace_no_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http, "MAX_CONNECTIONS_OF_ADDRESS", 2)
    groups = iter(["neighbour", *["crowd"] * 4])
    async with service(tmp_path) as mcp:
        monkeypatch.setattr(http, "address_group", lambda address: next(groups))
        address = httpx.URL(mcp.url)
        opened = [await asyncio.open_connection(address.host, address.port) for _ in range(5)]
        for reader, _ in opened[1:3]:
            assert await reader.read() == b""
        await asyncio.sleep(0)
        assert not any(reader.at_eof() for reader, _ in (opened[0], *opened[3:]))
        for _, writer in opened:
            writer.close()


async def test_requests_with_too_many_values_are_refused(tmp_path: Path) -> None:
    async with service(tmp_path) as mcp:
        ada = mcp.token("ada")
        session = await mcp.opened(ada)
        values = [0] * MAX_BODY_VALUES
        shapes: list[object] = [values, {"x": values}, [[]] * MAX_BODY_VALUES]
        for many in shapes:
            answer = await mcp.send({**PING, "params": {"_meta": {"x": many}}}, ada, session)
            assert answer.status_code == 400
            assert "more than 2,000 values" in answer.json()["error"]["message"]
        text = 'many "marks", \\' + "[{," * MAX_BODY_VALUES
        answer = await mcp.send({**PING, "params": {"_meta": {"x": text}}}, ada, session)
        assert answer.status_code == 200


@pytest.mark.parametrize(
    ("address", "group"),
    [
        ("192.0.2.1", "192.0.2.1"),
        ("2001:db8::1:2:3:4", "2001:db8::/64"),
        ("127.0.0.1", ""),
        ("::1", ""),
    ],
)
def test_addresses_are_grouped_by_network_and_loopback_has_no_limit(
    address: str, group: str
) -> None:
    assert sessions.address_group(address) == group
