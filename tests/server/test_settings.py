"""Settings come from flags, the environment and a file, and a wrong one is named."""

from __future__ import annotations

import asyncio
import re
import subprocess
import sys
from pathlib import Path

import pytest

from robotouille_client import connect
from robotouille_server.cli import main
from tests.support.processes import COMMAND, process


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
        (["--mode", "sundial"], "--mode: Input should be 'turn', 'lockstep' or 'realtime'"),
        (["--port", "70000"], "--port: Input should be less than or equal to 65535"),
        (["--config", "no-such.toml"], "no-such.toml"),
        (["--frobnicate"], "No such option"),
    ],
)
def test_a_wrong_flag_is_named(
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
def test_a_kitchen_that_cannot_be_opened_is_named(
    tmp_path: Path, flags: list[str], words: str
) -> None:
    arguments = [*COMMAND, "--recordings", str(tmp_path), "--port", "0", *flags]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    assert done.returncode != 0
    assert words in re.sub(r"\s+", " ", done.stderr.replace("│", " "))
    assert "Traceback" not in done.stderr


def test_a_wrong_setting_is_named_as_it_was_written(
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
    assert f"{config}: no setting 'prot'; did you mean 'port'?" in lines
    assert any(line.startswith(f"{config}: grace: Input should be a valid") for line in lines)
    assert any(line.startswith("ROBOTOUILLE_PORT: Input should be a valid") for line in lines)
    assert any(line.startswith("--step-rate: Input should be greater than") for line in lines)
    assert len(lines) == 4
