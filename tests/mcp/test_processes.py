"""The program itself, over standard input and output and over HTTP, with the SDK's client."""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from robotouille.replay.recording import read_recording
from tests.support.mcp_agent import (
    COMMAND,
    Agent,
    http_server,
    over,
    over_stdio,
    shortest_plan,
    with_bearer,
)
from tests.support.server_process import ServerProcess, server_process

pytestmark = pytest.mark.process

ALONE = "synchronous/01"
ADA = {"name": "ada", "version": "1"}
PING = {"jsonrpc": "2.0", "id": 1, "method": "ping"}
ACCEPT = {"accept": "application/json, text/event-stream"}


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    with server_process(tmp_path_factory.mktemp("mcp"), "--log-level", "warning") as it:
        yield it


async def play_to_the_goal(agent: Agent) -> None:
    code = await agent.opened(ALONE, clock="lockstep")
    game = (await agent.call("join", episode=code, name="ada"))["game"]
    for action in shortest_plan(ALONE):
        view = await agent.call("act", action=action, game=game)
    assert view["outcome"]["reason"] == "goal"
    await agent.call("leave", game=game)


async def played(target: Any, mode: str) -> None:
    async with over(target, mode) as agent:
        await play_to_the_goal(agent)


async def free_seats(agent: Agent, code: str) -> list[str]:
    rows = (await agent.call("list_episodes"))["episodes"]
    return next(row["free_seats"] for row in rows if row["code"] == code)


def test_stdio_process_leaves_when_its_client_goes(server: ServerProcess, tmp_path: Path) -> None:
    asyncio.run(played(over_stdio(server.url), "auto"))

    async def gone() -> list[str]:
        async with over(over_stdio(server.url)) as ada:
            code = await ada.opened(ALONE)
            await ada.call("join", episode=code)
        async with over(over_stdio(server.url)) as bob:
            return await free_seats(bob, code)

    assert asyncio.run(gone()) == ["robot1"]
    done = [read_recording(file) for file in server.recordings.glob("*.rbt")]
    assert [r.participants for r in done] == [{"robot1": ("ada", "model")}]
    assert all(recording.verify().ok for recording in done)


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_signal_frees_the_seat_of_a_silent_client(
    server: ServerProcess, signum: signal.Signals
) -> None:
    async def waiting() -> str:
        async with over(over_stdio(server.url)) as bob:
            return await bob.opened(ALONE)

    code = asyncio.run(waiting())
    hello = {"protocolVersion": "2025-06-18", "capabilities": {}}
    requests = [
        {"id": 1, "method": "initialize", "params": {**hello, "clientInfo": ADA}},
        {"method": "notifications/initialized"},
        {
            "id": 2,
            "method": "tools/call",
            "params": {"name": "join", "arguments": {"episode": code}},
        },
    ]
    with subprocess.Popen(
        [*COMMAND, "--url", server.url], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as silent:
        assert silent.stdin is not None and silent.stdout is not None
        for request in requests:
            print(json.dumps({"jsonrpc": "2.0", **request}), file=silent.stdin, flush=True)
        answers = [json.loads(silent.stdout.readline()) for _ in range(2)]
        assert not answers[1]["result"].get("isError"), answers
        silent.send_signal(signum)
        assert silent.wait(timeout=30) == 128 + signum

    async def free() -> list[str]:
        async with over(over_stdio(server.url)) as bob:
            return await free_seats(bob, code)

    assert asyncio.run(free()) == ["robot1"]


def test_http_process_serves_both_protocol_versions(server: ServerProcess) -> None:
    async def main(url: str) -> None:
        await asyncio.gather(played(url, "auto"), played(url, "legacy"))
        async with over(url) as ada, over(url, "legacy") as bob:
            code = await ada.opened(ALONE)
            assert "handle" in await ada.refused("observe")
            game = (await bob.call("join", episode=code))["game"]
            assert "handle" in await ada.refused("observe")
            assert await free_seats(ada, code) == []
        async with over(url) as ada:
            assert await free_seats(ada, code) == ["robot1"]  # bob has ended his session
            assert "no game" in await ada.refused("observe", game=game)
            await ada.call("join", episode=code)
        codes.append(code)

    codes: list[str] = []
    with http_server(server.url) as url:
        asyncio.run(main(url))
    with http_server(server.url) as url:  # the first was told to stop, and has left
        asyncio.run(nobody_is_in(url, *codes))


async def nobody_is_in(url: str, code: str) -> None:
    async with over(url) as ada:
        assert await free_seats(ada, code) == ["robot1"]


def test_web_pages_and_large_requests_are_refused(
    server: ServerProcess, capfd: pytest.CaptureFixture[str]
) -> None:
    with http_server(server.url) as url, httpx.Client(trust_env=False) as http:
        for headers, status in [
            ({"host": "evil.example.org"}, 421),
            ({"host": "127.0.0.1.evil.example.org:80"}, 421),
            ({"origin": "https://evil.example.org"}, 403),
            ({"origin": "null"}, 403),
        ]:
            assert http.post(url, json=PING, headers={**ACCEPT, **headers}).status_code == status
        large = {**PING, "params": {"x": "x" * 70_000}}
        assert http.post(url, json=large, headers=ACCEPT).status_code == 413
    assert not capfd.readouterr().err, "strangers must not fill the log"


def test_requests_through_a_proxy_need_a_token(tmp_path: Path) -> None:
    with server_process(tmp_path, "--require-token", "--log-level", "error") as server:
        keys = tmp_path / "recordings.state/keys.json"
        mint = "from robotouille_server.auth.token_cli import main; main()"
        mint_token = subprocess.run(
            [COMMAND[0], "-c", mint, "mint", "host", "--subject", "p-1", "--keys", str(keys)],
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        with http_server(server.url, "--allow-host", "kitchen.example.org") as url:
            asyncio.run(tokens(url, mint_token))


async def tokens(url: str, good: str) -> None:
    proxied = {"host": "kitchen.example.org", "origin": "https://kitchen.example.org"}
    async with httpx.AsyncClient(trust_env=False) as http:
        answer = await http.post(url, json=PING, headers={**ACCEPT, **proxied})
        assert answer.status_code == 401
        assert answer.headers["www-authenticate"].startswith("Bearer")
        stateless = {**ACCEPT, **proxied, "mcp-protocol-version": "2026-07-28"}
        for wrong in ("nonsense", good + "x"):
            stateless["authorization"] = f"Bearer {wrong}"
            answer = await http.post(url, json=PING, headers=stateless)
            assert answer.status_code == 401
            assert "invalid token" in answer.text
    async with with_bearer(url, good, **proxied) as ada:
        await play_to_the_goal(ada)
        game = (await ada.call("join", episode=await ada.opened(ALONE)))["game"]
        assert (await ada.call("observe", game=game))["game"] == game


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (["--listen", "0.0.0.0:0"], "--allow-host"),
        (["--listen", "8766"], "HOST:PORT"),
        (["--listen", "127.0.0.1:0", "--token", "secret"], "its own token"),
    ],
)
def test_unsafe_settings_are_refused(flags: list[str], complaint: str) -> None:
    done = subprocess.run([*COMMAND, *flags], capture_output=True, text=True)
    assert done.returncode == 1
    assert complaint in done.stderr
    assert "secret" not in done.stderr


def test_missing_sdk_names_the_extra() -> None:
    program = "import sys; sys.modules['mcp'] = None\n" + COMMAND[2]
    done = subprocess.run([COMMAND[0], "-c", program], capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.strip().endswith("pip install 'robotouille[mcp]'")
