"""The operator is warned before something runs out."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from robotouille_server import Server
from robotouille_server.health import SAMPLE_SECONDS, Disk, Health
from robotouille_server.health import alerts as found
from robotouille_server.runtime.metrics import Metrics
from tests.support.machines import GIB, Machine
from tests.support.operator import Api, table, viewing
from tests.support.servers import raw
from tests.support.virtual_time import run


async def alerts(server: Server, api: Api) -> dict[str, tuple[str, str]]:
    await asyncio.sleep(SAMPLE_SECONDS + 1)
    seen = (await api.get("/api/overview"))["alerts"]
    return {alert["kind"]: (alert["severity"], alert["text"]) for alert in seen}


def on_machine(tmp_path: Path, check: Any) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (server, _, api):
            machine = server.health.system = Machine()
            assert await alerts(server, api) == {}
            await check(server, api, machine)

    run(main())


@pytest.mark.parametrize(
    ("disk", "severity", "words"),
    [
        (Disk(900 * 1024**2, 10 * GIB), "warning", "900 MiB (8.8%) are free"),
        (Disk(40 * GIB, 1000 * GIB), "warning", "40 GIB (4.0%)"),
        (Disk(50 * 1024**2, 10 * GIB), "critical", "50 MiB"),
        (Disk(2 * GIB, 10 * GIB), "", ""),
    ],
)
def test_a_disk_that_fills_up(tmp_path: Path, disk: Disk, severity: str, words: str) -> None:
    async def check(server: Server, api: Api, machine: Machine) -> None:
        machine.free = disk
        told = await alerts(server, api)
        assert told.get("disk", ("", ""))[0] == severity
        assert words.lower() in told.get("disk", ("", ""))[1].lower()

    on_machine(tmp_path, check)


def test_a_recordings_folder_that_is_gone(tmp_path: Path) -> None:
    async def check(server: Server, api: Api, machine: Machine) -> None:
        (tmp_path / "r").rmdir()
        told = await alerts(server, api)
        assert told["disk"] == ("critical", "the recordings folder: No such file or directory")

    on_machine(tmp_path / "r", check)


def test_descriptors_that_run_out(tmp_path: Path) -> None:
    async def check(server: Server, api: Api, machine: Machine) -> None:
        machine.open = 801
        assert (await alerts(server, api))["descriptors"][0] == "warning"
        machine.open = 951
        severity, text = (await alerts(server, api))["descriptors"]
        assert (severity, "951 of 1,000" in text) == ("critical", True)

    on_machine(tmp_path, check)


def test_log_lines_that_are_held_back() -> None:
    metrics = Metrics()
    resources = Health(metrics, None, Machine())
    metrics.log_suppressed = 5
    resources.sample(0.0, [])
    assert found(resources) == []
    metrics.log_suppressed += 1200
    resources.sample(SAMPLE_SECONDS, [])
    (alert,) = found(resources)
    assert (alert.kind, alert.text) == ("log", "1,200 log lines held back in the last minute")
    for second in range(10, 61, 10):
        resources.sample(second, [])
        assert found(resources) == [alert]
    resources.sample(70, [])
    assert found(resources) == []


def test_a_participant_who_sends_far_too_much(tmp_path: Path) -> None:
    async def check(server: Server, api: Api, machine: Machine) -> None:
        async with raw(server, name="eve") as eve, table(server):
            await alerts(server, api)
            for _ in range(50):
                await eve.ask({"type": "zap", "more": "x" * 20_000}, "error")
            told = await alerts(server, api)
            assert told["participant"][0] == "warning"
            assert "'eve' sends" in told["participant"][1]
            assert "participant" not in await alerts(server, api)

    on_machine(tmp_path, check)


def test_what_is_critical_comes_first(tmp_path: Path) -> None:
    async def check(server: Server, api: Api, machine: Machine) -> None:
        machine.free, machine.open = Disk(900 * 1024**2, 10 * GIB), 990
        assert list(await alerts(server, api)) == ["descriptors", "disk"]

    on_machine(tmp_path, check)


def test_who_sent_how_much_and_what_of_it_is_on_record(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (server, _, api), table(server) as play:
            game = play.games[0]
            await play.until(lambda game: game.step >= 1)
            before = (await api.row(play.episode))["seats"]
            game.say("é" * 100)
            assert (await game.act(game.state.actions("robot1")[0], reasoning="x" * 300)).applied
            after = (await api.row(play.episode))["seats"]
            assert after[0]["recorded_bytes"] - before[0]["recorded_bytes"] == 500
            assert after[0]["received_bytes"] - before[0]["received_bytes"] > 500
            assert after[1]["recorded_bytes"] == 0
            sessions = {session.name: session for session in server.sessions.by_id.values()}
            sent = sessions["ada"].received_bytes
            assert sessions["ada"].peer is not None
            sessions["ada"].peer.socket.transport.abort()
            await asyncio.sleep(1)
            await play.until(lambda game: game.step >= 12)
            assert sessions["ada"].peer is not None
            assert sessions["ada"].received_bytes > sent

    run(main())
