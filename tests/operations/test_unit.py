"""systemd accepts the unit in the operations guide, as a service and as a template."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from robotouille_server import ServerSettings
from tests.support.pages import read, titled

PAGE = "operate_a_server.md"
UNIT = "/etc/systemd/system/robotouille.service"
CONFIG = "/etc/robotouille.toml"
SERVER = "/opt/robotouille/bin/robotouille-server"

needs_systemd = pytest.mark.skipif(
    not shutil.which("systemd-analyze"), reason="systemd-analyze is not installed"
)


def complaints(folder: Path, name: str, unit: str, instance: str) -> str:
    """Return systemd's errors for a unit, with its program and user replaced by existing ones."""
    assert unit.count(SERVER) == unit.count("User=robotouille") == 1
    unit = unit.replace(SERVER, sys.executable).replace("User=robotouille", "User=root")
    (folder / name).write_text(unit)
    command = ["systemd-analyze", "verify", "--man=no", str(folder / instance)]
    environment = {**os.environ, "SYSTEMD_UNIT_PATH": f"{folder}:"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60)
    lines = [line for line in done.stderr.splitlines() if "robotouille" in line]
    return "\n".join(lines or ([done.stderr] if done.returncode else []))


@pytest.mark.process
@needs_systemd
def test_unit_is_accepted(tmp_path: Path) -> None:
    name = "robotouille.service"
    assert complaints(tmp_path, name, titled(PAGE, UNIT), name) == ""


@pytest.mark.process
@needs_systemd
def test_template_for_rolling_restarts_is_accepted(tmp_path: Path) -> None:
    (flag,) = re.findall(r"add `(--operator-port %i)` to `ExecStart`", read(PAGE))
    (name,) = re.findall(r"Name the unit `(\S+)`", read(PAGE))
    (command,) = re.findall("^ExecStart=.*$", titled(PAGE, UNIT), re.MULTILINE)
    unit = titled(PAGE, UNIT).replace(command, f"{command} {flag}")
    instances = set(re.findall(r"systemctl enable --now (robotouille@\d+)", read(PAGE)))
    assert len(instances) == 2
    for instance in instances:
        assert complaints(tmp_path, name, unit, f"{instance}.service") == ""


def test_unit_allows_enough_time_and_file_descriptors() -> None:
    """The settings in the guide are valid and fit the unit's limits and folders."""
    given = tomllib.loads(titled(PAGE, CONFIG))
    settings = ServerSettings(**given)
    unit = dict(line.split("=", 1) for line in titled(PAGE, UNIT).splitlines() if "=" in line)
    assert unit["ExecStart"] == f"{SERVER} --config {CONFIG}"
    assert float(unit["TimeoutStopSec"]) > settings.drain_seconds
    assert int(unit["LimitNOFILE"]) > settings.max_connections
    # Without these, a runaway server takes the machine down instead of being restarted.
    assert unit["MemoryMax"].endswith("G")
    assert int(unit["TasksMax"]) > 0
    assert settings.recordings.is_relative_to(f"/var/lib/{unit['StateDirectory']}")
