"""The container image contains what it needs, and its health checks work."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

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
    files = {
        "pyproject.toml",
        "requirements-image.lock",
        project["readme"],
        *project["license-files"],
    }
    assert copied == folders | files
    assert all((ROOT / name).exists() for name in copied)


def test_image_contains_programs_of_the_lab() -> None:
    locked = pins("requirements-image.lock")
    for extra in ("operator", "data", "mqtt", "cluster"):
        assert not missing(PROJECT["project"]["optional-dependencies"][extra], locked)


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


# Lock files


def pins(lock: str) -> dict[str, list[Version]]:
    """Return the versions of each package in a lock file; markers may select one of several."""
    found: dict[str, list[Version]] = {}
    for line in (ROOT / lock).read_text(encoding="utf-8").splitlines():
        if not line.startswith(("#", " ")):
            name, version = line.removesuffix("\\").split(";")[0].strip().split("==")
            found.setdefault(canonicalize_name(name), []).append(Version(version))
    return found


def missing(
    requirements: Iterable[str | dict[str, str]], locked: dict[str, list[Version]]
) -> list[str]:
    """Return the requirements that a lock file does not meet."""
    named = [Requirement(each) for each in requirements if isinstance(each, str)]
    return [
        str(each)
        for each in named
        if each.name != "robotouille"
        and not any(
            version in each.specifier for version in locked.get(canonicalize_name(each.name), ())
        )
    ]


def test_lock_files_meet_the_requirements() -> None:
    """Run `make lock` after a change to `pyproject.toml`."""
    project, groups = PROJECT["project"], PROJECT["dependency-groups"]
    extras = project["optional-dependencies"]
    (everything,) = extras["all"]
    for lock, needed in {
        "requirements.lock": [
            *(extras[name] for name in Requirement(everything).extras),
            *(groups[name] for name in ("build", "dev", "docs")),
        ],
        "requirements-image.lock": [groups["build"]],
    }.items():
        locked = pins(lock)
        assert not [
            each for part in (project["dependencies"], *needed) for each in missing(part, locked)
        ]


@pytest.mark.parametrize("lock", ["requirements.lock", "requirements-image.lock"])
def test_lock_files_pin_hashes_and_no_addresses(lock: str) -> None:
    text = (ROOT / lock).read_text(encoding="utf-8")
    assert "://" not in text and "--index" not in text and "--find" not in text
    entries = re.split(r"\n(?! )", text.strip())
    assert all("==" in each and "--hash=sha256:" in each for each in entries if each[0] != "#")
