"""Samples of disk space and file descriptors, and the warnings about them."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from robotouille_server import Server
from robotouille_server.health import SAMPLE_SECONDS, Disk, Health, System
from robotouille_server.health import alerts as found
from robotouille_server.runtime.metrics import ClusterMetrics, Metrics
from tests.support.machines import GIB, Machine
from tests.support.operator import Api, table, viewing
from tests.support.servers import raw, serving
from tests.support.virtual_time import run, virtual


async def metrics_page(server: Server) -> str:
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    writer.write(b"GET /metrics HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
    page = (await reader.read()).decode()
    writer.close()
    return page.partition("\r\n\r\n")[2]


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
        (Disk(900 * 1024**2, 10 * GIB), "warning", "900 MiB (8.8%) left"),
        (Disk(40 * GIB, 1000 * GIB), "warning", "40 GIB (4.0%)"),
        (Disk(50 * 1024**2, 10 * GIB), "critical", "50 MiB"),
        (Disk(2 * GIB, 10 * GIB), "", ""),
    ],
)
def test_nearly_full_disk(tmp_path: Path, disk: Disk, severity: str, words: str) -> None:
    async def check(server: Server, api: Api, machine: Machine) -> None:
        machine.free = disk
        shown = await alerts(server, api)
        assert shown.get("disk", ("", ""))[0] == severity
        assert words.lower() in shown.get("disk", ("", ""))[1].lower()

    on_machine(tmp_path, check)


def test_disk_without_space_for_new_episodes() -> None:
    machine = Machine()
    health = Health(Metrics(), Path.cwd(), machine, reserve=2 * GIB)
    for now, (free, severities) in enumerate([(2 * GIB, []), (2 * GIB - 1, ["critical"])]):
        machine.free = Disk(free, 10 * GIB)
        health.sample(now * SAMPLE_SECONDS, [])
        assert [alert.severity for alert in found(health)] == severities
    assert "2 GiB (20.0%) left, so no episodes are opened" in found(health)[0].text


def test_missing_recordings_folder(tmp_path: Path) -> None:
    async def check(server: Server, api: Api, machine: Machine) -> None:
        (tmp_path / "r").rmdir()
        shown = await alerts(server, api)
        assert shown["disk"] == ("critical", "the recordings folder: No such file or directory")

    on_machine(tmp_path / "r", check)


def test_few_free_file_descriptors(tmp_path: Path) -> None:
    async def check(server: Server, api: Api, machine: Machine) -> None:
        machine.open = 801
        assert (await alerts(server, api))["descriptors"][0] == "warning"
        machine.open = 951
        severity, text = (await alerts(server, api))["descriptors"]
        assert (severity, "951 of 1,000" in text) == ("critical", True)

    on_machine(tmp_path, check)


def test_suppressed_log_lines() -> None:
    metrics = Metrics()
    resources = Health(metrics, None, Machine())
    metrics.log_suppressed = 5
    resources.sample(0.0, [])
    assert found(resources) == []
    metrics.log_suppressed += 1200
    resources.sample(SAMPLE_SECONDS, [])
    (alert,) = found(resources)
    assert (alert.kind, alert.text) == ("log", "1,200 log lines suppressed in the last minute")
    for second in range(10, 61, 10):
        resources.sample(second, [])
        assert found(resources) == [alert]
    resources.sample(70, [])
    assert found(resources) == []


def test_participant_who_sends_too_much(tmp_path: Path) -> None:
    async def check(server: Server, api: Api, machine: Machine) -> None:
        async with raw(server, name="eve") as eve, table(server):
            await alerts(server, api)
            for _ in range(50):
                await eve.ask({"type": "zap", "more": "x" * 20_000}, "error")
            shown = await alerts(server, api)
            assert shown["participant"][0] == "warning"
            assert "'eve' sends" in shown["participant"][1]
            assert "participant" not in await alerts(server, api)

    on_machine(tmp_path, check)


def test_critical_alerts_come_first(tmp_path: Path) -> None:
    async def check(server: Server, api: Api, machine: Machine) -> None:
        machine.free, machine.open = Disk(900 * 1024**2, 10 * GIB), 990
        assert list(await alerts(server, api)) == ["descriptors", "disk"]

    on_machine(tmp_path, check)


@virtual
async def test_received_and_recorded_bytes_are_counted_per_seat(tmp_path: Path) -> None:
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


@virtual
async def test_metrics_show_the_samples(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        machine = server.health.system = Machine()
        machine.free, machine.open, machine.most = Disk(123, 456), 77, 99
        server.metrics.log_suppressed = 3
        page = await metrics_page(server)
    for line in (
        "robotouille_disk_free_bytes 123.0",
        "robotouille_open_descriptors 77.0",
        "robotouille_max_descriptors 99.0",
        "robotouille_suppressed_log_lines_total 3.0",
        "robotouille_busiest_participant_bytes_per_second 0.0",
    ):
        assert f"\n{line}\n" in page


def test_metrics_read_in_a_loop_are_written_once_a_second() -> None:
    metrics = Metrics()
    first = metrics.recent_page(5.0)
    metrics.steps += 1
    assert metrics.recent_page(5.9) is first
    assert b"\nrobotouille_steps_total 1.0\n" in metrics.recent_page(6.0)


@virtual
async def test_requests_within_a_second_get_the_same_page_of_metrics(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        first = await metrics_page(server)
        async with raw(server) as host:
            await host.ask({"type": "create", "task": "synchronous/01"}, "created")
            assert {await metrics_page(server) for _ in range(5)} == {first}
            await asyncio.sleep(1)
            second = await metrics_page(server)
    assert "\nrobotouille_episodes 0.0\n" in first
    assert "\nrobotouille_episodes 1.0\n" in second


def test_real_machine_reports_disk_and_descriptors(tmp_path: Path) -> None:
    system = System()
    disk, used, most = system.disk(tmp_path), system.descriptors(), system.max_descriptors()
    assert disk is None or 0 < disk.free <= disk.size
    assert used is None or most is None or 3 <= used <= most
    with tmp_path.joinpath("x").open("w"):
        assert used is None or system.descriptors() == used + 1


RULES = Path(__file__).parents[2] / "lab" / "robotouille.rules.yml"
SERIES = re.compile(r"(robotouille_\w+)(?:\{([^}]*)\})?")


@virtual
async def test_series_of_all_alerts_exist_before_the_first_event(tmp_path: Path) -> None:
    # Prometheus sees no increase in a series that begins with its first event.
    rules = yaml.safe_load(RULES.read_text(encoding="utf-8"))
    wanted = [SERIES.findall(rule["expr"]) for rule in rules["groups"][0]["rules"]]
    async with serving(tmp_path) as server:
        server.sample(0.0)
        server.metrics.cluster = ClusterMetrics()
        lines = server.metrics.page().decode().splitlines()
    # Without `--mqtt` there is no broker that could be lost.
    assert not any(line.startswith("robotouille_mqtt_connected ") for line in lines)
    for name, label in (series for rule in wanted for series in rule):
        if name == "robotouille_mqtt_connected":
            continue
        assert any(re.match(name + r"[ {]", line) and label in line for line in lines), name


@virtual
async def test_counters_with_labels_begin_at_zero(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        lines = server.metrics.page().decode().splitlines()
    assert 'robotouille_errors_total{code="rate/codes"} 0.0' in lines
    assert 'robotouille_dropped_connections_total{reason="flood"} 0.0' in lines
    assert 'robotouille_outcomes_total{reason="goal"} 0.0' in lines
