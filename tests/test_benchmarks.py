"""The benchmarks still run, in tiny form: what they find means nothing here."""

from __future__ import annotations

import asyncio
import io
import os
import re
from typing import Any

import msgpack
import pytest
from benchmarks import batch, core, flat, joint, model_calls, mqtt, planning
from benchmarks.flat import Growth, Memory, memory_over_steps
from benchmarks.server import BARE, OURS, STEPS, Bench, memory_row, print_rows, server
from rich.console import Console
from websockets.asyncio.client import connect
from websockets.typing import Subprotocol

from robotouille.protocol.codec import MSGPACK
from robotouille_server.rooms.recordings.storage import Storage

MIB = 2**20


async def answer(url: str, **message: Any) -> dict[str, Any]:
    """What a server answers to one message."""
    async with connect(url, subprotocols=[Subprotocol(MSGPACK.name)]) as socket:
        await socket.send(msgpack.packb(message))
        answered: dict[str, Any] = msgpack.unpackb(await socket.recv(decode=False))
        return answered


def test_the_hot_paths_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(core, "WALK", 400)
    row = core.measure("synchronous/01")
    assert min(row.load, row.steps, row.actions, row.memory) > 0
    assert 0 < row.delta_p95 < row.snapshot
    lines = core.table([row])
    assert all(len(line) == 2 for line in lines)
    assert any(re.search(r"\(\d+\.\d×\)", cell) for _, cell in lines), "nothing beside its aim"


def test_joint_steps_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joint, "STEPS", 60)
    row = joint.measure("multi_agent/01@4", "people")
    assert min(row.single, row.cold, row.warmed, row.again) > 0


@pytest.mark.parametrize(
    ("interface", "task"),
    [
        ("gymnasium", "synchronous/01"),
        ("vector", "synchronous/01"),
        ("pettingzoo", "multi_agent/01"),
    ],
)
def test_environments_are_measured(
    interface: str, task: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("gymnasium")
    pytest.importorskip("pettingzoo")
    from benchmarks import environments

    monkeypatch.setattr(environments, "STEPS", 60)
    row = environments.measure(interface, task)
    assert min(row.cold, row.warmed, row.again) > 0


def test_the_batch_engine_is_measured() -> None:
    row = batch.measure("synchronous/01", steps=60, copies=4)
    assert min(row.world, row.world_masks, row.batch, row.batch_masks, row.batch_vectors) > 0


def test_planning_is_measured() -> None:
    ((seconds, proven, expansions),) = planning.certify(["synchronous/01"])
    assert seconds < planning.SECONDS and proven and expansions > 0
    assert planning.transitions("synchronous/01", 200) > 0


@pytest.mark.process
@pytest.mark.parametrize("which", [BARE, OURS])
def test_both_servers_answer_a_hello(which: str) -> None:
    everyone = tuple(range(os.cpu_count() or 1))
    bench = Bench(1.0, None, everyone, everyone, Console(quiet=True))
    with server(which, bench) as (pid, url):
        assert pid > 0
        welcome = asyncio.run(answer(url, type="hello", protocol=1, name="ada"))
    assert welcome["type"] == "welcome"
    assert ("bare" in welcome["server"]) == (which == BARE)


@pytest.mark.process
@pytest.mark.slow
def test_the_memory_is_looked_at_over_some_thousand_steps() -> None:
    growth = memory_over_steps(2000)
    assert 1900 < growth.steps < 2100
    assert min(growth.first, growth.last) > 10 * MIB


def test_the_servers_storage_in_memory_does_what_a_storage_does() -> None:
    storage: Storage = Memory()
    file = storage.create("a.part")
    file.append(b"whole, torn")
    file.close()
    again = storage.resume("a.part")
    again.cut(5)
    again.append(b"!")
    assert storage.read("a.part") == b"whole!"
    storage.replace("a", b"closed")
    storage.remove("a.part")
    assert storage.names() == []


@pytest.mark.parametrize(
    ("growth", "met"),
    [
        (Growth(100 * MIB, 101 * MIB, STEPS - 1000), True),
        (Growth(100 * MIB, 101 * MIB, 1_000_000), None),
        (Growth(100 * MIB, 106 * MIB, 1_000_000), False),
        (Growth(100 * MIB, 106 * MIB, STEPS), False),
    ],
)
def test_the_row_of_the_memory_says_over_how_many_steps_it_was(
    growth: Growth, met: bool | None
) -> None:
    row = memory_row(growth)
    assert f"over {growth.steps:,} steps" in row.name
    assert row.target == "flat over 10,000,000"
    assert row.met is met
    console = Console(record=True, width=120, file=io.StringIO())
    print_rows([row], console)
    assert f"{growth.steps:,}" in console.export_text()


def test_simulated_time_passes_at_once() -> None:
    with asyncio.Runner(loop_factory=flat.SimulatedLoop) as runner:
        begun = runner.get_loop().time()
        runner.run(asyncio.sleep(3600))
        assert runner.get_loop().time() - begun >= 3600


@pytest.mark.process
@pytest.mark.slow
def test_calls_of_models_are_measured(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("openai")
    model_calls.main(["--episodes", "2", "--calls", "1", "--thinking", "0.05"])
    scripted, endpoint = re.findall(r"(\S+) ms \(under", capsys.readouterr().out)
    assert float(scripted) > 0 and float(endpoint) > 0


def test_what_mqtt_costs_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mqtt, "CALLS", 100)
    used = {mqtt.OFF: [0.2], mqtt.SILENT: [0.2], mqtt.WATCHED: [0.25]}
    found = {row.name.strip(): row for row in mqtt.rows(used)}
    assert found["more for that, of a core"].met
    assert 0 < mqtt.tap_seconds(watched=False) < mqtt.tap_seconds(watched=True)


def test_the_viewer_is_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pygame")
    from benchmarks import viewer

    monkeypatch.setattr(viewer, "SEEKS", 3)
    viewer.main(["--steps", "150"])
    assert "150 steps" in capsys.readouterr().out


@pytest.mark.process
@pytest.mark.slow
def test_the_start_of_the_window_is_measured() -> None:
    pytest.importorskip("pygame")
    from benchmarks import startup

    first, kitchen = startup.first_pictures(startup.COMMANDS["robotouille-client"])
    assert first == kitchen
    assert min(first) > 0
