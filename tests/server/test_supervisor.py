"""Several processes on one port: clients find their episodes, and a worker that dies comes back."""

from __future__ import annotations

import asyncio
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from robotouille.replay.recording import read_recording
from robotouille_client import connect
from tests.support.worker_processes import COMMAND, workers


@pytest.mark.process
@pytest.mark.slow
def test_clients_are_sent_to_the_process_that_has_their_episode(tmp_path: Path) -> None:
    async def main(port: int) -> set[int]:
        homes = set()
        for _ in range(8):
            url = f"ws://127.0.0.1:{port}"
            async with connect(url, name="ada") as ada, connect(url, name="bob") as bob:
                created = await ada.create("multi_agent/02", max_steps=2)
                games = [await ada.join(created.code), await bob.join(created.code.lower())]
                for _step in range(2):
                    await asyncio.gather(*(game.act(None) for game in games))
                for game in games:
                    assert [event async for event in game][-1].reason == "step_limit"
                homes.add(int(created.episode[:2], 16))
        return homes

    with workers(tmp_path, 2) as (_, port):
        homes = asyncio.run(main(port))
        assert homes == {0, 1}, "all episodes were with one worker"
    recordings = [read_recording(file) for file in tmp_path.glob("*.rbt")]
    assert len(recordings) == 8
    assert all(recording.verify().complete for recording in recordings)


@pytest.mark.process
@pytest.mark.slow
def test_a_worker_that_is_killed_comes_back_with_its_episodes(tmp_path: Path) -> None:
    async def main(port: int, supervisor: psutil.Process) -> None:
        url = f"ws://127.0.0.1:{port}"
        async with connect(url, name="ada", seed=1) as ada:
            games = []
            async with connect(url, name="bob", seed=2) as bob:
                for client in (ada, bob):
                    created = await client.create("synchronous/01")
                    games.append(await client.join(created.code))
                for game in games:
                    assert (await game.act(game.actions[0])).applied
                for process in supervisor.children():
                    process.kill()
                for game in games:
                    assert (await game.act(game.actions[0])).applied
                    assert game.step == 2

    with workers(tmp_path, 2) as (process, port):
        asyncio.run(main(port, psutil.Process(process.pid)))


@pytest.mark.process
@pytest.mark.slow
def test_a_signal_stops_all_of_them(tmp_path: Path) -> None:
    with workers(tmp_path, 2) as (process, port):
        children = psutil.Process(process.pid).children()
        assert len(children) == 2
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=30) == 0
        assert not [child for child in children if child.is_running()]
        with socket.socket() as probe:
            assert probe.connect_ex(("127.0.0.1", port)) != 0


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="orphans are seen by their parent's number")
def test_workers_do_not_outlive_their_supervisor(tmp_path: Path) -> None:
    with workers(tmp_path, 2) as (process, _):
        children = psutil.Process(process.pid).children()
        process.kill()
        gone, alive = psutil.wait_procs(children, timeout=30)
        assert len(gone) == 2
        assert not alive


@pytest.mark.process
def test_a_fixed_port_is_needed(tmp_path: Path) -> None:
    arguments = [*COMMAND, "--workers", "2", "--port", "0", "--recordings", str(tmp_path)]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert re.search("--workers needs a fixed --port", done.stderr)
