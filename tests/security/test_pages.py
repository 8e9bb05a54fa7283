"""Examples in the documentation of security and operation."""

from __future__ import annotations

import asyncio
import re
import sys
import tomllib
from pathlib import Path

import pytest

from robotouille import ProtocolError
from robotouille_client import connect
from robotouille_server import ServerSettings
from robotouille_server.runtime.metrics import Metrics
from tests.support.pages import read, titled
from tests.support.servers import serving
from tests.support.sources import ROOT

PAGES = ("security.md", "operate_a_server.md")


async def output(*words: str) -> str:
    process = await asyncio.create_subprocess_exec(
        sys.executable, *words, stdout=asyncio.subprocess.PIPE
    )
    text, _ = await process.communicate()
    return text.decode().strip()


@pytest.mark.process
def test_token_of_another_program_is_accepted(tmp_path: Path) -> None:
    (tmp_path / "mint.py").write_text(titled("security.md", "mint.py"), encoding="utf-8")

    async def scenario() -> None:
        keys = tmp_path / "keys.json"
        async with serving(tmp_path / "r", keys=keys, require_token=True) as server:
            token = await output(str(tmp_path / "mint.py"), str(keys))
            async with connect(server.url, name="robin", token=token) as client:
                assert client.role == "player"
            with pytest.raises(ProtocolError) as refused:
                async with connect(server.url, name="robin", token=token[:-3]):
                    pass
            assert refused.value.code == "auth/invalid"

    asyncio.run(scenario())


@pytest.mark.process
def test_settings_of_the_service_are_valid(tmp_path: Path) -> None:
    file = tmp_path / "robotouille.toml"
    file.write_text(titled("operate_a_server.md", "/etc/robotouille.toml"), encoding="utf-8")
    settings = ServerSettings(config=file)
    assert settings.require_token
    unit = titled("operate_a_server.md", "/etc/systemd/system/robotouille.service")
    numbers = dict(re.findall(r"^(\w+)=(\d+)$", unit, re.MULTILINE))
    assert int(numbers["TimeoutStopSec"]) > settings.drain_seconds
    assert int(numbers["LimitNOFILE"]) > settings.max_connections


@pytest.mark.parametrize("page", PAGES)
def test_every_flag_of_the_server_exists(page: str) -> None:
    flags = {f"--{name.replace('_', '-')}" for name in ServerSettings.model_fields}
    for command in re.findall(r"robotouille-server ([^\n`]*)", read(page)):
        used = re.findall(r"--[a-z-]+", command.partition("#")[0])
        assert {flag.replace("--no-", "--") for flag in used} <= flags, command


@pytest.mark.parametrize("page", PAGES)
def test_every_documented_code_is_sent(page: str) -> None:
    sources = "".join(
        path.read_text(encoding="utf-8")
        for folder in ("server", "shared")
        for path in (ROOT / folder).rglob("*.py")
    )
    kinds = "message|auth|rate|server|episode|seat|session|action"
    for code in re.findall(rf"`((?:{kinds})/[a-z-]+)`", read(page)):
        assert f'"{code}"' in sources, code


def test_every_documented_metric_exists() -> None:
    known = {
        family.name + ("_total" if family.type == "counter" else "")
        for family in Metrics().registry.collect()
    }
    assert set(re.findall(r"`(robotouille_[a-z_]+)", read("operate_a_server.md"))) <= known


def test_every_documented_setting_exists() -> None:
    text = "".join(read(page) for page in PAGES)
    named = set(re.findall(r"\(`([a-z_]+)`\)|setting `([a-z_]+)`", text))
    others = {"moved", "aborted"}  # a message and an outcome
    assert {"".join(pair) for pair in named} - others <= set(ServerSettings.model_fields)


def test_setting_files_are_valid() -> None:
    page = read("operate_a_server.md")
    for block in re.findall(r"^```toml[^\n]*\n(.*?)^```$", page, re.S | re.M):
        assert set(tomllib.loads(block)) <= set(ServerSettings.model_fields)
