"""NATS servers that are too old, full or without JetStream, and buckets deleted in play."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import nats
import pytest
from nats.errors import TimeoutError as NatsTimeoutError
from nats.js import JetStreamContext
from nats.js.errors import APIError, NotFoundError, ServiceUnavailableError
from nats.js.object_store import ObjectStore

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.nats.address import NatsAddress
from robotouille.replay.recording import read_recording
from robotouille_client import Client, Game, connect
from robotouille_server import Server, ServerSettings, serve
from robotouille_server.cluster.joining import joined
from robotouille_server.cluster.nats.nats_bus import nats_bus
from tests.support.lying_nats import GREETING, lying_nats
from tests.support.nats import missing, nats_cluster

pytestmark = [
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(bool(missing()), reason=missing()),
]

TASK = "training/03_multi_agent"
PATIENCE = 60
KIB = 1024


@asynccontextmanager
async def node(urls: list[str], folder: Path) -> AsyncIterator[Server]:
    """Run a node of a cluster."""
    settings = ServerSettings(cluster=",".join(urls), recordings=folder, port=0, countdown=0.0)
    async with (
        joined(settings) as cluster,
        serve(settings, cluster.around) as server,
        cluster.serving(server),
    ):
        yield server


@asynccontextmanager
async def operator(urls: list[str]) -> AsyncIterator[JetStreamContext]:
    """Connect to JetStream as an operator with the command `nats` does."""
    client = await nats.connect(urls)
    try:
        yield client.jetstream()
    finally:
        await client.close()


async def two_players(ada: Client, bob: Client) -> tuple[Game, Game]:
    created = await ada.create(TASK, seats=2, move_budget=0, max_steps=6)
    return await ada.join(created.code), await bob.join(created.code)


async def step(*games: Game) -> None:
    await asyncio.gather(*(game.act(None) for game in games))


async def until(true: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not true():
            await asyncio.sleep(0.05)


def test_version_that_is_too_old_is_named() -> None:
    async def begin(url: str) -> None:
        async with nats_bus(NatsAddress((url,), "robotouille")):
            pass

    with lying_nats({}, {**GREETING, "version": "2.8.4"}) as (url, _):
        with pytest.raises(RobotouilleError, match=r"version 2\.8\.4; at least 2\.9 is required"):
            asyncio.run(begin(url))


async def test_account_without_jetstream_is_named(tmp_path: Path) -> None:
    accounts = ["accounts {LAB {users: [{user: ann, password: right}]}}"]
    password = tmp_path / "password"
    password.write_text("right\n")
    password.chmod(0o600)
    with nats_cluster(tmp_path / "nats", 1, accounts) as servers:
        url = servers.url(0).replace("//", "//ann@")
        settings = ServerSettings(
            cluster=url, cluster_password_file=password, recordings=tmp_path / "recordings"
        )
        with pytest.raises(RobotouilleError, match="the account of this user has no JetStream"):
            async with joined(settings):
                pass


async def test_node_does_not_start_if_jetstream_is_full(tmp_path: Path) -> None:
    with nats_cluster(tmp_path / "nats", 1, file_store="1MB") as servers:
        async with operator(servers.urls) as jetstream:
            await fill(jetstream, 1)
        with pytest.raises(RobotouilleError, match="--cluster: JetStream is full"):
            async with node(servers.urls, tmp_path / "recordings"):
                pass


async def fill(jetstream: JetStreamContext, replicas: int) -> None:
    """Store messages until JetStream is full."""
    await jetstream.add_stream(name="ballast", subjects=["ballast"], num_replicas=replicas)
    with pytest.raises(APIError):
        while True:
            await jetstream.publish("ballast", bytes(8 * KIB))


async def delete(jetstream: JetStreamContext, stream: str) -> None:
    """Delete a stream, also while NATS elects a leader."""
    async with asyncio.timeout(PATIENCE):
        while True:
            with suppress(NatsTimeoutError, ServiceUnavailableError):
                # An earlier attempt may have been done, but not answered.
                with suppress(NotFoundError):
                    await jetstream.delete_stream(stream)
                return


@pytest.mark.parametrize("servers", [1, 3])
async def test_games_wait_while_jetstream_is_full(tmp_path: Path, servers: int) -> None:
    folder = tmp_path / "recordings"
    with nats_cluster(tmp_path / "nats", servers, file_store="1MB") as running:
        async with (
            node(running.urls, folder) as server,
            connect(server.url, name="ada") as ada,
            connect(server.url, name="bob") as bob,
            operator(running.urls) as jetstream,
        ):
            games = await two_players(ada, bob)
            await step(*games)
            await fill(jetstream, servers)
            with pytest.raises(ProtocolError, match=r"JetStream is full.*max_file_store"):
                await ada.create(TASK)
            acting = asyncio.gather(*(game.act(None) for game in games))
            await until(lambda: games[0].pause is not None)
            assert games[0].pause is not None
            assert games[0].pause.reason == "storage"
            assert games[0].step == 1
            await delete(jetstream, "ballast")
            await acting
            for _ in range(4):
                await step(*games)
            assert games[0].ended
            await until(lambda: bool(list(folder.glob("*.rbt"))))
        (path,) = folder.glob("*.rbt")
        found = read_recording(path).verify()
        assert found.ok
        assert found.complete
        assert found.steps == 6


async def exists(jetstream: JetStreamContext, stream: str) -> None:
    """Wait until the nodes have created a stream again."""
    async with asyncio.timeout(PATIENCE):
        while True:
            with suppress(APIError):
                await jetstream.stream_info(stream)
                return
            await asyncio.sleep(0.1)


async def stored(files: ObjectStore) -> None:
    """Wait until there is a file."""
    async with asyncio.timeout(PATIENCE):
        while True:
            with suppress(NotFoundError):
                if await files.list():
                    return
            await asyncio.sleep(0.1)


@pytest.mark.parametrize(
    "stream",
    [
        "KV_robotouille_nodes",
        "KV_robotouille_episodes",
        "KV_robotouille_shared",
        "OBJ_robotouille_recordings",
    ],
)
async def test_game_goes_on_after_a_bucket_was_deleted(tmp_path: Path, stream: str) -> None:
    folders = tmp_path / "a", tmp_path / "b"
    with nats_cluster(tmp_path / "nats", 1) as servers:
        async with (
            node(servers.urls, folders[0]) as server,
            node(servers.urls, folders[1]) as other,
            connect(server.url, name="ada") as ada,
            connect(other.url, name="bob") as bob,
            operator(servers.urls) as jetstream,
        ):
            games = await two_players(ada, bob)
            await step(*games)
            await delete(jetstream, stream)
            await step(*games)
            await exists(jetstream, stream)
            for _ in range(4):
                await step(*games)
            assert games[0].ended
            await until(lambda: bool(list(tmp_path.glob("*/*.rbt"))))
            (path,) = tmp_path.glob("*/*.rbt")
            async with connect(other.url, name="cy") as cy, connect(server.url, name="di") as di:
                await step(*await two_players(cy, di))
            keys = await jetstream.key_value("robotouille_shared")
            assert (await keys.get("keys")).value
            files = await jetstream.object_store("robotouille_recordings")
            await stored(files)
        found = read_recording(path).verify()
        assert (found.ok, found.complete, found.steps) == (True, True, 6)


async def test_new_games_open_after_the_journals_were_deleted(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    with nats_cluster(tmp_path / "nats", 1) as servers:
        async with (
            node(servers.urls, folder) as server,
            connect(server.url, name="ada") as ada,
            connect(server.url, name="bob") as bob,
            operator(servers.urls) as jetstream,
        ):
            games = await two_players(ada, bob)
            await step(*games)
            await delete(jetstream, "robotouille_journal")
            async with asyncio.timeout(PATIENCE):
                await step(*games)
            assert games[0].ended
            assert "it has ended" in games[0].farewell
            async with connect(server.url, name="cy") as cy, connect(server.url, name="di") as di:
                await step(*await two_players(cy, di))
