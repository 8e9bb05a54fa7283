"""The operator is warned before something runs out."""

from __future__ import annotations

import asyncio
import errno
import os
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille_server import Server
from robotouille_server.alerts import alerts as found
from robotouille_server.health import SAMPLE_SECONDS, Disk, Health, System
from robotouille_server.runtime import descriptors
from robotouille_server.runtime.metrics import Metrics
from tests.operator.support import Api, table, viewing
from tests.support.machines import GIB, Machine
from tests.support.servers import raw, serving
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


def test_looking_is_rare_however_often_somebody_asks(tmp_path: Path) -> None:
    machine = Machine()
    resources = Health(Metrics(), tmp_path, machine)
    for tick in range(101):
        resources.sample(tick / 10, [])
    assert machine.looks == 1 + 10 / SAMPLE_SECONDS


def test_metrics_have_the_same_figures(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            machine = server.health.system = Machine()
            machine.free, machine.open, machine.most = Disk(123, 456), 77, 99
            server.metrics.log_suppressed = 3
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            writer.write(b"GET /metrics HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            page = (await reader.read()).decode()
            writer.close()
        for line in (
            "robotouille_disk_free_bytes 123.0",
            "robotouille_open_descriptors 77.0",
            "robotouille_max_descriptors 99.0",
            "robotouille_suppressed_log_lines_total 3.0",
            "robotouille_busiest_participant_bytes_per_second 0.0",
        ):
            assert f"\n{line}\n" in page

    run(main())


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


def test_the_real_machine_has_a_disk_and_descriptors(tmp_path: Path) -> None:
    system = System()
    disk, used, most = system.disk(tmp_path), system.descriptors(), system.max_descriptors()
    assert disk is None or 0 < disk.free <= disk.size
    assert used is None or most is None or 3 <= used <= most
    with tmp_path.joinpath("x").open("w"):
        assert used is None or system.descriptors() == used + 1


@pytest.mark.skipif(sys.platform == "win32", reason="nobody says it there")
def test_descriptors_are_counted_without_listing_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 20,000 a list takes 50 ms, for which all games would wait."""

    def listed(*_: Any) -> None:
        raise AssertionError("listed")

    for module, name in ((os, "listdir"), (os, "scandir"), (Path, "iterdir")):
        monkeypatch.setattr(module, name, listed)
    used = System().descriptors()
    monkeypatch.setattr(descriptors, "OPEN", str(tmp_path / "nothing says it"))
    at_least = System().descriptors()
    assert used is not None
    assert at_least is not None
    assert 3 <= at_least <= used + 1
    with ExitStack() as stack:
        for _ in range(used + 1):
            stack.enter_context(open(os.devnull))  # noqa: PTH123
        assert (System().descriptors() or 0) > used


@pytest.mark.skipif(sys.platform == "win32", reason="nobody says it there")
def test_a_process_without_any_descriptor_left_says_that_all_are_in_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: Any) -> int:
        raise OSError(errno.EMFILE, "too many open files")

    monkeypatch.setattr(descriptors, "OPEN", str(tmp_path / "nothing says it"))
    monkeypatch.setattr(os, "open", refused)
    assert System().descriptors() == descriptors.limit()
