"""The container's files: what is copied is what a build needs, and the health check tells."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.support.pages import ROOT
from tests.support.processes import process


def health(port: str) -> int:
    """The exit status of the health check, asked of another port than the container's."""
    compose = (ROOT / "docker-compose.yml").read_text(encoding="utf-8")
    (found,) = re.findall(r"^ +test: (\[.*\])$", compose, re.MULTILINE)
    kind, program, *arguments = json.loads(found)
    assert (kind, program) == ("CMD", "python")
    assert ":8765/" in arguments[-1]
    arguments[-1] = arguments[-1].replace(":8765/", f":{port}/")
    command = [sys.executable, *arguments]
    return subprocess.run(command, stderr=subprocess.DEVNULL, timeout=60).returncode


@pytest.mark.process
def test_the_health_check_tells_a_server_from_none(tmp_path: Path) -> None:
    with process(tmp_path / "recordings") as (_, url, _code):
        port = url.rpartition(":")[2]
        assert health(port) == 0
    assert health(port) != 0


def test_an_image_has_all_that_the_package_is_built_from_and_nothing_else() -> None:
    """Least of all recordings and keys that lie in the same folder."""
    docker = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    copied = {
        name
        for line in re.findall("^COPY (.*) \\S+$", docker, re.MULTILINE)
        for name in line.split()
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    folders = {path.split("/")[0] for path in (*wheel["packages"], *wheel["force-include"])}
    files = {"pyproject.toml", project["project"]["readme"], *project["project"]["license-files"]}
    assert copied == folders | files
    assert all((ROOT / name).exists() for name in copied)
