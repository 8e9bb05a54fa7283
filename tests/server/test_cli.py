"""The server as a process: flags, files, signals, health and metrics."""

from __future__ import annotations

import asyncio
import signal
import subprocess
from pathlib import Path
from urllib.request import urlopen

import psutil
import pytest

from robotouille.replay.recording import read_recording
from robotouille_client import GameEnded, connect
from tests.support.processes import COMMAND, process, started


async def play_until_signal(
    url: str, code: str, server: subprocess.Popen[str], number: int
) -> GameEnded:
    async with connect(url, name="ada", reconnect=False) as client:
        game = await client.join(code)
        result = await game.act(game.actions[0])
        assert result.applied
        server.send_signal(number)
        async for event in game:
            if isinstance(event, GameEnded):
                return event
    raise AssertionError("the game did not end")


@pytest.mark.process
def test_ctrl_c_tells_the_clients_and_closes_the_recordings(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    with process(folder, "--task", "synchronous/01") as (server, url, code):
        over = asyncio.run(play_until_signal(url, code, server, signal.SIGINT))
        assert over.outcome["reason"] == "aborted"
        assert over.outcome["detail"] == "the server shuts down"
        assert server.wait(timeout=20) == 0
    (file,) = folder.iterdir()
    assert file.suffix == ".rbt"
    recording = read_recording(file)
    assert recording.verify().ok
    assert recording.outcome == over.outcome


@pytest.mark.process
@pytest.mark.smoke
def test_sigterm_leaves_the_episodes_to_the_next_process(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    flags = ("--task", "synchronous/01", "--drain-seconds", "0")
    with process(folder, *flags) as (server, url, code):
        over = asyncio.run(play_until_signal(url, code, server, signal.SIGTERM))
        assert over.outcome == {}
        assert server.wait(timeout=20) == 0
    (file,) = folder.iterdir()
    assert file.name.endswith(".rbt.part")
    recording = read_recording(file)
    assert recording.verify().ok
    assert len(recording.steps) == 1

    async def step(url: str) -> int:
        async with connect(url, name="bob") as client:
            return (await client.join(code, role="spectator")).step

    with process(folder, *flags) as (_, url, _code):
        assert asyncio.run(step(url)) == 1


@pytest.mark.process
def test_health_and_metrics_on_the_same_port(tmp_path: Path) -> None:
    async def play(url: str, code: str) -> None:
        async with connect(url, name="ada") as client:
            game = await client.join(code)
            for _ in range(3):
                await game.act(None)

    with process(tmp_path, "--task", "synchronous/01", "--max-steps", "3") as (_, url, code):
        http = url.replace("ws://", "http://")
        assert urlopen(f"{http}/healthz").read() == b"ok\n"
        asyncio.run(play(url, code))
        page = urlopen(f"{http}/metrics")
        assert page.headers["Content-Type"].startswith("text/plain; version=0.0.4")
        text = page.read().decode()
    assert "robotouille_steps_total 3.0" in text
    assert 'robotouille_outcomes_total{reason="step_limit"} 1.0' in text
    assert "robotouille_connections " in text


@pytest.mark.process
def test_port_in_use_is_reported(tmp_path: Path) -> None:
    with process(tmp_path, "--task", "synchronous/01") as (_, url, _code):
        port = url.rsplit(":", 1)[1]
        arguments = [*COMMAND, "--port", port, "--recordings", str(tmp_path)]
        done = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert f"cannot listen on 127.0.0.1:{port}" in done.stderr
    assert done.stderr.splitlines()[0].endswith("; choose another port with --port")


@pytest.mark.process
@pytest.mark.parametrize(
    "words", [("--task", "nope"), ("--task", "synchronous/01", "--seats", "7")]
)
def test_invalid_task_is_reported_before_the_server_listens(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    arguments = [*COMMAND, "--port", "0", "--recordings", str(tmp_path / "recordings"), *words]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("robotouille-server: --task: ")
    assert not line.endswith("(task)")
    assert not (tmp_path / "recordings").exists()


@pytest.mark.process
def test_logs_as_json(tmp_path: Path) -> None:
    import json

    with process(tmp_path, "--task", "synchronous/01", "--log-format", "json") as (server, _, code):
        server.send_signal(signal.SIGINT)
        _, errors = server.communicate(timeout=20)
    rows = [json.loads(line) for line in errors.splitlines()]
    assert any({"event": "episode opened", "code": code}.items() <= row.items() for row in rows)
    assert rows[-1]["event"] == "stopped"


@pytest.mark.process
def test_only_this_machine_is_served_unless_told_otherwise(tmp_path: Path) -> None:
    def served(*flags: str) -> tuple[set[str], bool]:
        with started(tmp_path, "--task", "synchronous/01", *flags) as (server, greeting):
            sockets = psutil.Process(server.pid).net_connections("tcp")
            hosts = {one.laddr.ip for one in sockets if one.status == psutil.CONN_LISTEN}
            return hosts, "only programs on this machine can connect" in greeting

    assert served() == ({"127.0.0.1"}, True)
    assert served("--host", "0.0.0.0", "--no-operator") == ({"0.0.0.0"}, False)
    assert served("--host", "0.0.0.0") == ({"0.0.0.0", "127.0.0.1"}, False)
