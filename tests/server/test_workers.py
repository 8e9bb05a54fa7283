"""Ids and codes that show the worker of an episode."""

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

from robotouille.protocol import messages
from robotouille.protocol.join_codes import plain_code
from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_server.runtime.workers import ElsewhereError, WorkerSlot
from tests.support.worker_processes import COMMAND, workers


@pytest.mark.parametrize(
    "typed",
    ["ABCDE-FGHJK", "abcde fghjk", "  abcdefghjk\n", "abc de\u00a0fgh - jk", "a-b-c-defghjk"],
)
def test_codes_ignore_dashes_spaces_and_case(typed: str) -> None:
    assert plain_code(typed) == "ABCDEFGHJK"


class TestNames:
    def test_worker_recognises_its_own_names(self) -> None:
        one = WorkerSlot(index=1, count=3, first_port=9001)
        episode = one.mark_id(0xFFFF_FFFF_FFFF_FFFF)
        assert one.owns(episode)
        assert not WorkerSlot(index=2, count=3).owns(episode)
        one.check_here(episode, episode.upper(), 10)
        assert one.mark_letter("Z") == "B"
        one.check_here("BXXXX-XXXXX", "BXXXXXXXXX", 10)

    def test_worker_redirects_other_names(self) -> None:
        one = WorkerSlot(
            index=1, count=3, first_port=9001, url="wss://kitchen.example.org/w{worker}"
        )
        with pytest.raises(ElsewhereError) as error:
            one.check_here("cxxxx-xxxxx", "CXXXXXXXXX", 10)
        assert error.value.moved(7) == messages.Moved(
            ref=7, episode="cxxxx-xxxxx", port=9003, url="wss://kitchen.example.org/w2"
        )

    def test_every_recording_has_an_owner_with_fewer_workers(self) -> None:
        ids = [WorkerSlot(index=i, count=8).mark_id(i * 7919) for i in range(8)]
        for episode in ids:
            assert sum(WorkerSlot(index=i, count=3).owns(episode) for i in range(3)) == 1
            assert WorkerSlot().owns(episode)


@pytest.mark.process
@pytest.mark.slow
def test_clients_are_redirected_to_the_right_worker(tmp_path: Path) -> None:
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
def test_killed_worker_is_replaced_with_its_episodes(tmp_path: Path) -> None:
    async def main(port: int, supervisor: psutil.Process) -> None:
        url = f"ws://127.0.0.1:{port}"
        async with connect(url, name="ada") as ada:
            games = []
            async with connect(url, name="bob") as bob:
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
def test_signal_stops_all_workers(tmp_path: Path) -> None:
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
def test_workers_need_a_fixed_port(tmp_path: Path) -> None:
    arguments = [*COMMAND, "--workers", "2", "--port", "0", "--recordings", str(tmp_path)]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert re.search("--workers needs a fixed --port", done.stderr)
