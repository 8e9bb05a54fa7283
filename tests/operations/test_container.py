"""The container image contains what it needs, and its health checks work."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from robotouille_server import ServerSettings
from tests.support.compose import compose
from tests.support.processes import process
from tests.support.sources import ROOT

DOCKER = (ROOT / "Dockerfile").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
(IMAGE_CHECK,) = re.findall(r"HEALTHCHECK [^\[]*CMD (\[.*\])$", DOCKER, re.MULTILINE)
CHECKS = [["CMD", *json.loads(IMAGE_CHECK)], compose()["services"]["server"]["healthcheck"]["test"]]


def health(check: list[str], port: str) -> int:
    """Return the exit status of a health check, run against another port."""
    kind, program, *arguments = check
    assert (kind, program) == ("CMD", "python")
    assert ":8765/" in arguments[-1]
    arguments[-1] = arguments[-1].replace(":8765/", f":{port}/")
    command = [sys.executable, *arguments]
    return subprocess.run(command, stderr=subprocess.DEVNULL, timeout=60).returncode


@pytest.mark.process
def test_health_checks_detect_a_missing_server(tmp_path: Path) -> None:
    with process(tmp_path / "recordings") as (_, url, _code):
        port = url.rpartition(":")[2]
        assert [health(check, port) for check in CHECKS] == [0, 0]
    assert 0 not in [health(check, port) for check in CHECKS]


def test_image_contains_only_build_inputs() -> None:
    """In particular, no recordings or keys from the same folder."""
    copied = {
        name
        for line in re.findall(r"^COPY (?!--from=build )(.*) \S+$", DOCKER, re.MULTILINE)
        for name in line.split()
    }
    wheel = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
    folders = {path.split("/")[0] for path in (*wheel["packages"], *wheel["force-include"])}
    project = PROJECT["project"]
    files = {"pyproject.toml", project["readme"], *project["license-files"]}
    assert copied == folders | files
    assert all((ROOT / name).exists() for name in copied)


def test_image_contains_programs_of_the_lab() -> None:
    (extras,) = re.findall(r"pip install --no-cache-dir '\.\[(.*)\]'", DOCKER)
    assert set(extras.split(",")) == {"operator", "data", "mqtt"}


def test_container_is_not_root_and_base_image_is_pinned() -> None:
    (user,) = re.findall(r"^USER (\d+):(\d+)$", DOCKER, re.MULTILINE)
    assert "0" not in user
    assert compose()["services"]["server"]["user"] == ":".join(user)
    bases = set(re.findall(r"^FROM (\S+)", DOCKER, re.MULTILINE))
    assert all(re.fullmatch(r"python:\d+\.\d+\.\d+-slim-\w+", base) for base in bases)


def test_settings_of_the_image_exist() -> None:
    given = dict(re.findall(r"\bROBOTOUILLE_(\w+)=(\S+)", DOCKER))
    settings = ServerSettings(**{name.lower(): value for name, value in given.items()})
    assert settings.host == settings.operator_host == "0.0.0.0"
    assert settings.keys == settings.state_folder / "keys.json"
    (ports,) = re.findall(r"^EXPOSE (.*)$", DOCKER, re.MULTILINE)
    assert ports.split() == [str(settings.port), str(settings.port + 1)]
