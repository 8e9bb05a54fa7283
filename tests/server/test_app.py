"""Server that starts, drains and fails; its settings and logs."""

from __future__ import annotations

import asyncio
import fcntl
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_server import ServerSettings, serve
from robotouille_server.app import CannotListenError
from robotouille_server.cli import main
from robotouille_server.runtime.settings import MAX_CONFIG_BYTES
from tests.support.processes import COMMAND, process
from tests.support.servers import crash, raw, serving
from tests.support.virtual_time import virtual


async def left_behind(folder: Path) -> None:
    """Return the folder of an episode whose server was killed."""
    async with serving(folder) as server, connect(server.url, name="ada") as ada:
        game = await ada.join((await ada.create("synchronous/01")).code)
        await game.act(game.actions[0])
        await crash(server)


def still_open(folder: Path) -> bool:
    (file,) = folder.iterdir()
    return file.name.endswith(".rbt.part") and read_recording(file).outcome is None


@virtual
async def test_port_in_use_ends_no_episode(tmp_path: Path) -> None:
    await left_behind(tmp_path / "a")
    async with serving(tmp_path / "b") as other:
        settings = ServerSettings(port=other.port, recordings=tmp_path / "a")
        with pytest.raises(CannotListenError):
            async with serve(settings):
                pass
    assert still_open(tmp_path / "a")


def _has_ipv6() -> bool:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        return False
    return True


@pytest.mark.skipif(not _has_ipv6(), reason="needs IPv6")
@virtual
async def test_ipv6_wildcard_listens_with_ipv4_too(tmp_path: Path) -> None:
    async with serve(ServerSettings(host="::", port=0, recordings=tmp_path)) as server:
        assert server.url == f"ws://127.0.0.1:{server.port}"
        for host in ("127.0.0.1", "[::1]"):
            async with connect(f"ws://{host}:{server.port}", name="ada") as client:
                assert client.role == "host"


@virtual
async def test_failure_ends_no_episode(tmp_path: Path) -> None:
    await left_behind(tmp_path)
    with pytest.raises(ZeroDivisionError):
        async with serving(tmp_path, seed=2) as server:
            assert len(server.lobby.rooms) == 1
            raise ZeroDivisionError
    assert still_open(tmp_path)


@virtual
async def test_message_during_shutdown_is_answered_by_the_shutdown_notice(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server, hello=False) as late:
        async with raw(server) as ada:
            created = await ada.ask({"type": "create", "task": "synchronous/01"}, "created")
            joined = await ada.ask({"type": "join", "episode": created["code"]}, "joined")
        hello = {"type": "hello", "protocol": 1, "name": "ada", "resume": joined["resume"]}
        await late.send(hello)
        stopping = asyncio.create_task(server.stop("restart", hand_over=True))
        answer = await late.receive()
        await stopping
        if answer["type"] == "welcome":
            answer = await late.expect("bye")
        assert (answer["type"], answer["code"], answer["retry"]) == (
            "bye",
            "server/restart",
            True,
        )


@virtual
async def test_draining_server_takes_over_no_recordings(tmp_path: Path) -> None:
    foreign = tmp_path / "20260101T000000Z_x_00000000000000aa.rbt.part"
    foreign.write_bytes(b"RBTL\x01")
    with foreign.open("ab") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        async with serving(tmp_path) as old, raw(old) as ada:
            created = await ada.ask({"type": "create", "task": "multi_agent/02"}, "created")
            await ada.ask({"type": "join", "episode": created["code"]}, "joined")
            assert created["episode"] in old.lobby.rooms
            draining = asyncio.create_task(old.drain(20))
            await asyncio.sleep(3)
            assert not old.lobby.rooms
            async with serving(tmp_path, seed=2) as new:
                assert list(new.lobby.rooms) == [created["episode"]]
            await draining


@pytest.mark.process
def test_settings_come_from_flag_then_environment_then_file(tmp_path: Path) -> None:
    config = tmp_path / "server.toml"
    config.write_text(
        'max_steps = 11\nstep_rate = 7.0\nmode = "realtime"\ntask = "synchronous/02"\n'
    )

    async def rules(url: str, code: str) -> dict[str, object]:
        async with connect(url, name="ada") as client:
            game = await client.join(code, role="spectator")
            return {**game.clock, "task": game.world.task.name}

    flags = ("--config", str(config), "--max-steps", "33")
    with process(tmp_path, *flags, ROBOTOUILLE_MAX_STEPS="22", ROBOTOUILLE_STEP_RATE="9") as (
        _,
        url,
        code,
    ):
        found = asyncio.run(rules(url, code))
    assert found["max_steps"] == 33
    assert found["step_rate"] == 9.0
    assert found["clock"] == "realtime"
    assert str(found["task"]).startswith("synchronous/02")


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (
            ["--mode", "realtme"],
            "--mode: unknown value 'realtme'; did you mean 'realtime'? "
            "(possible: turn, lockstep, realtime)",
        ),
        (
            ["--log-level", "x"],
            "--log-level: unknown value 'x' (possible: debug, info, warning, error)",
        ),
        (["--step-rate", "fast"], "robotouille-server: --step-rate: 'fast' is not a number"),
        (["--seed", "1.5"], "robotouille-server: --seed: '1.5' is not a whole number"),
        (["--seed", "9" * 35], "--seed: Input should be less than or equal to 9007199254740992"),
        (["--port", "70000"], "--port: Input should be less than or equal to 65535"),
        (["--config", "no-such.toml"], "no-such.toml"),
        (["--host", ""], "--host: not a host name or an address, such as 127.0.0.1, found ''"),
        (["--host", ".a"], "--host: not a host name"),
        (["--operator-host", "a" * 300], "--operator-host: not a host name"),
        (["--state", "a\0b"], "--state: a setting must not contain a null character"),
        (["--keys", "."], "--keys: the path must end with a name"),
        (["--recordings", "/"], "--recordings: the path must end with a name"),
        (["--frobnicate"], "No such option"),
    ],
)
def test_invalid_flag_is_reported(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    flags: list[str],
    words: str,
) -> None:
    monkeypatch.setattr(sys, "argv", ["robotouille-server", *flags])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    errors = capsys.readouterr().err
    assert words in re.sub(r"\s+", " ", errors.replace("│", " "))
    assert "Traceback" not in errors


@pytest.mark.process
@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--task", "synchronus/01"], "no task or file 'synchronus/01'"),
        (["--task", "synchronous/01", "--seats", "3"], "possible: 1"),
    ],
)
def test_unknown_task_is_reported(tmp_path: Path, flags: list[str], words: str) -> None:
    arguments = [*COMMAND, "--recordings", str(tmp_path), "--port", "0", *flags]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    assert done.returncode != 0
    assert words in re.sub(r"\s+", " ", done.stderr.replace("│", " "))
    assert "Traceback" not in done.stderr


def test_invalid_setting_is_reported_as_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "server.toml"
    config.write_text('prot = 8000\ngrace = "long"\nmax_steps = 7\n')
    monkeypatch.setenv("ROBOTOUILLE_PORT", "eight")
    flags = ["--recordings", str(tmp_path), "--config", str(config), "--step-rate", "-1"]
    monkeypatch.setattr(sys, "argv", ["robotouille-server", *flags])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith("robotouille-server: ") for line in lines)
    said = [line.removeprefix("robotouille-server: ") for line in lines]
    assert f"{config}: unknown setting 'prot'; did you mean 'port'?" in said
    assert f"{config}: grace: 'long' is not a number" in said
    assert "ROBOTOUILLE_PORT: 'eight' is not a whole number" in said
    assert any(line.startswith("--step-rate: Input should be greater than") for line in said)
    assert len(said) == 4


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (f"a = {'[' * 20_000}", "values are nested too deeply"),
        (f"#{'a' * MAX_CONFIG_BYTES}", "is larger than 1 MiB; it may be the wrong file"),
        ('host = "a\\u0000b"', "host: a setting must not contain a null character"),
    ],
)
def test_strange_config_is_reported_in_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    content: str,
    words: str,
) -> None:
    config = tmp_path / "server.toml"
    config.write_text(content)
    monkeypatch.setattr(sys, "argv", ["robotouille-server", "--config", str(config)])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(config) in line
    assert words in line
