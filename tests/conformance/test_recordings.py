"""A recording's frames, read independently in Node by the documentation alone."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille.replay.container import read_frames, unwrap
from robotouille_client import connect
from tests.conformance.node import run_node
from tests.support.games import recorded_game
from tests.support.server_process import ServerProcess

pytestmark = pytest.mark.process


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("cut", [0, 1, 700])
def test_node_reads_the_frames_that_python_reads(tmp_path: Path, cut: int, version: int) -> None:
    stream = recorded_game("multi_agent/10@3", seed=2, steps=110, version=version)
    path = tmp_path / "game.rbt.part"
    path.write_bytes(stream[: len(stream) - cut])
    found = run_node("recording", path=str(path))
    assert found["version"] == version
    assert found["frames"] == list(read_frames(stream[: len(stream) - cut]))
    assert len(found["frames"]) > 110


def test_node_reads_a_recording_that_a_server_is_writing(server: ServerProcess) -> None:
    async def play() -> None:
        async with connect(server.url, name="adá") as client:
            created = await client.create(task="synchronous/01", clock="lockstep")
            game = await client.join(created.code)
            for _ in range(12):
                await game.act(game.actions[0])
            found = await asyncio.to_thread(check, server, game.episode)
            assert found > 12

    asyncio.run(play())


def check(server: ServerProcess, episode: str) -> int:
    (path,) = server.recordings.glob(f"*{episode}*.rbt.part")
    frames = run_node("recording", path=str(path))["frames"]
    assert frames == list(read_frames(unwrap(path.read_bytes())))
    assert frames[0]["episode"] == episode
    assert [f["step"] for f in frames if f["kind"] == "step"] == list(range(1, 13))
    return len(frames)
