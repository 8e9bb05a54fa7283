"""Servers work behind nginx and Caddy with the configuration in the operations guide."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import AsyncExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from robotouille import ProtocolError
from robotouille.replay.recording import read_recording
from robotouille_client import Client, Game, GameEnded, connect
from robotouille_client.bots import play
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_server.auth.visitors import PROBATION_FACTOR
from tests.operations.proxies import PROXIES, Front, Proxy, front_door, mint, program
from tests.support.lost_connections import cut
from tests.support.processes import process
from tests.support.worker_processes import free_ports, workers

pytestmark = [pytest.mark.process, pytest.mark.slow]

BEHIND = ("--trust-proxy", "loopback")
SECONDS = 60
"""Timeout of a test."""


@pytest.fixture(params=PROXIES)
def proxy(request: pytest.FixtureRequest) -> Proxy:
    name: str = request.param
    if not program(name):
        pytest.skip(f"{name} is not installed")
    return PROXIES[name]


@contextmanager
def served(proxy: Proxy, folder: Path, *flags: str) -> Iterator[tuple[Front, Path]]:
    """Run a server behind a proxy. Its recordings are closed when the context exits."""
    recordings = folder / "recordings"
    with process(recordings, *BEHIND, *flags) as (server, url, _code):
        behind = int(url.rpartition(":")[2])
        with proxy(folder, free_ports(1), behind, 1) as front, front.trusted():
            yield front, recordings
        server.send_signal(signal.SIGINT)
        assert server.wait(timeout=SECONDS) == 0


async def refused(url: str) -> str:
    """Return the error code of a `list` request without a token."""
    with pytest.raises(ProtocolError) as error:
        async with connect(url, name="stranger", reconnect=False) as stranger:
            await stranger.episodes()
    return error.value.code


def test_client_without_token_does_not_count_as_local(proxy: Proxy, tmp_path: Path) -> None:
    with served(proxy, tmp_path) as (front, _):
        assert asyncio.run(refused(front.url)) == "auth/role"


def test_only_clients_with_a_token_play(proxy: Proxy, tmp_path: Path) -> None:
    with served(proxy, tmp_path, "--require-token") as (front, recordings):
        assert asyncio.run(refused(front.url)) == "auth/required"
        token = mint("host", "lab", recordings)
        outcome = asyncio.run(bots_play(front.url, token))
    assert outcome["reason"] == "goal"
    (file,) = recordings.glob("*.rbt")
    assert read_recording(file).verify().complete


async def bots_play(url: str, token: str) -> Mapping[str, Any]:
    """Let two planners play an episode to its end, and cut one connection."""
    planner = policy_maker(BotKind.PLANNER)
    async with asyncio.timeout(SECONDS), AsyncExitStack() as stack:
        clients = [
            await stack.enter_async_context(connect(url, name=name, token=token))
            for name in ("ada", "bob")
        ]
        games = await seats(clients, "multi_agent/01")
        await asyncio.gather(*(game.act(None) for game in games))
        cut(clients[0])
        return (await asyncio.gather(*(play(game, planner) for game in games)))[0]


async def seats(clients: list[Client], task: str, **rules: Any) -> list[Game]:
    created = await clients[0].create(task, **rules)
    return [await client.join(created.code) for client in clients]


@pytest.mark.skipif(sys.platform != "linux", reason="needs all of 127.0.0.0/8")
def test_connections_are_counted_per_client_address(proxy: Proxy, tmp_path: Path) -> None:
    async def knocks(front: Front) -> None:
        async with AsyncExitStack() as stack:
            first, other, *_ = [
                await stack.enter_async_context(await front.knock(source))
                for source in ("127.0.0.2", "127.0.0.3", *["127.0.0.2"] * PROBATION_FACTOR)
            ]
            assert json.loads(await first.recv())["code"] == "rate/connections"
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.1):
                    await other.recv()

    with served(proxy, tmp_path, "--max-connections-per-address", "1") as (front, _):
        asyncio.run(knocks(front))


def test_client_is_redirected_to_the_right_worker(proxy: Proxy, tmp_path: Path) -> None:
    recordings = tmp_path / "recordings"
    port = free_ports(1)
    flags = (*BEHIND, "--require-token", "--worker-url", f"{front_door(port)}/w{{worker}}")
    with workers(recordings, 2, *flags) as (_, behind):
        token = mint("host", "lab", recordings)
        with proxy(tmp_path, port, behind, 2) as front, front.trusted():
            for home in ("w0", "w1"):
                asyncio.run(play_with_worker(front, token, home))
    files = list(recordings.glob("*.rbt"))
    assert len(files) == 2
    assert all(read_recording(file).verify().complete for file in files)


async def play_with_worker(front: Front, token: str, home: str) -> None:
    """Create an episode on one worker and join it through the other."""
    other = {"w0": "w1", "w1": "w0"}[home]
    async with (
        asyncio.timeout(SECONDS),
        connect(f"{front.url}/{home}", name="ada", token=token) as ada,
        connect(f"{front.url}/{other}", name="bob", token=token) as bob,
    ):
        games = await seats([ada, bob], "multi_agent/02", max_steps=2)
        assert bob.url == f"{front.url}/{home}"
        for _ in range(2):
            await asyncio.gather(*(game.act(None) for game in games))
        for game in games:
            *_, over = [event async for event in game]
            assert isinstance(over, GameEnded)
            assert over.outcome["reason"] == "step_limit"
