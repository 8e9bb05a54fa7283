"""The benchmarks run in a short form, whose results mean nothing."""

from __future__ import annotations

import argparse
import asyncio
import os
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import pytest
from benchmarks import batch, core, joint, model_calls, mqtt, parts, peers, planning
from benchmarks.flat import memory_over_steps
from benchmarks.server import BARE, OURS, Bench, server
from rich.console import Console
from websockets.asyncio.client import connect
from websockets.typing import Subprotocol

from robotouille.protocol.codec import MSGPACK

MIB = 2**20


async def answer(url: str, **message: Any) -> dict[str, Any]:
    """Send one message and return the reply."""
    async with connect(url, subprotocols=[Subprotocol(MSGPACK.name)]) as socket:
        await socket.send(msgpack.packb(message))
        answered: dict[str, Any] = msgpack.unpackb(await socket.recv(decode=False))
        return answered


def test_hot_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(core, "WALK", 400)
    row = core.measure("synchronous/01")
    assert min(row.load, row.steps, row.actions, row.memory) > 0
    assert 0 < row.delta_p95 < row.snapshot
    lines = core.table([row])
    assert all(len(line) == 2 for line in lines)
    assert any(re.search(r"\(\d+\.\d×\)", cell) for _, cell in lines), "nothing beside its aim"


def test_joint_steps(monkeypatch: pytest.MonkeyPatch) -> None:
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
def test_environments(interface: str, task: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("gymnasium")
    pytest.importorskip("pettingzoo")
    from benchmarks import environments

    monkeypatch.setattr(environments, "STEPS", 60)
    row = environments.measure(interface, task)
    assert min(row.cold, row.warmed, row.again) > 0


def test_resets_of_environments() -> None:
    pytest.importorskip("gymnasium")
    pytest.importorskip("pettingzoo")
    from benchmarks import environments

    row = environments.measure_resets("synchronous/01", count=3)
    assert 0 < row.median <= row.worst


def test_batch_engine() -> None:
    row = batch.measure("synchronous/01", steps=60, copies=4)
    assert min(row.world, row.world_masks, row.batch, row.batch_masks, row.batch_vectors) > 0


def test_planning() -> None:
    ((seconds, proven, expansions),) = planning.certify(["synchronous/01"])
    assert seconds < planning.SECONDS and proven and expansions > 0
    assert planning.transitions("synchronous/01", 200) > 0


@pytest.mark.process
@pytest.mark.parametrize("which", [BARE, OURS])
def test_both_servers_reply_to_hello(which: str) -> None:
    everyone = tuple(range(os.cpu_count() or 1))
    bench = Bench(1.0, None, everyone, everyone, Console(quiet=True))
    with server(which, bench) as (pid, url):
        assert pid > 0
        welcome = asyncio.run(answer(url, type="hello", protocol=1, name="ada"))
    assert welcome["type"] == "welcome"
    assert ("bare" in welcome["server"]) == (which == BARE)


@pytest.mark.process
@pytest.mark.slow
def test_memory_over_2000_steps() -> None:
    growth = memory_over_steps(2000)
    assert 1900 < growth.steps < 2100
    assert min(growth.first, growth.last) > 10 * MIB


@pytest.mark.process
@pytest.mark.slow
def test_model_calls(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("openai")
    model_calls.main(["--episodes", "2", "--calls", "1", "--thinking", "0.05"])
    scripted, endpoint = re.findall(r"(\S+) ms \(under", capsys.readouterr().out)
    assert float(scripted) > 0 and float(endpoint) > 0


def test_mqtt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mqtt, "CALLS", 100)
    used = {mqtt.OFF: [0.2], mqtt.SILENT: [0.2], mqtt.WATCHED: [0.25]}
    found = {row.name.strip(): row for row in mqtt.rows(used)}
    assert found["increase when watched, of a core"].met
    assert 0 < mqtt.tap_seconds(watched=False) < mqtt.tap_seconds(watched=True)


def test_peers_run_other_builds_of_the_server(tmp_path: Path) -> None:
    here = peers.parse_build("")
    other = peers.parse_build(f"tree={here.tree} python=/bin/python GC=1 --workers 2")
    assert other.tree == here.tree and other.python == "/bin/python"
    assert other.variables() == {**here.variables(), "GC": "1"}
    assert other.flags == ("--workers", "2")
    with pytest.raises(argparse.ArgumentTypeError, match="not a checkout"):
        peers.parse_build(f"tree={tmp_path}")


def test_peers_measures_in_turns_and_shows_ratios() -> None:
    order: list[str] = []

    def side(name: str, *cores: float) -> Callable[[], peers.Figures]:
        figures = iter(cores)
        return lambda: order.append(name) or {"cores used": next(figures)}  # type: ignore[func-returns-value]

    sides = {"A": side("A", 0.2, 0.3, 0.6), "B": side("B", 0.1, 0.2, 0.2)}
    results = peers.measure(sides, 3)
    assert order == ["A", "B", "B", "A", "A", "B"]
    console = Console(width=100)
    with console.capture() as shown:
        console.print(peers.table(results))
    assert "A / B" in shown.get()
    assert re.search(r"0\.300 .*0\.200 .*2\.00 \(1\.50–3\.00\)", shown.get())


@pytest.mark.process
def test_colyseus_programs_are_valid() -> None:
    if shutil.which("node") is None:
        pytest.skip("Node is not installed")
    for program in peers.PROGRAMS.glob("*.mjs"):
        subprocess.run(["node", "--check", program], check=True)


@pytest.mark.process
@pytest.mark.slow
def test_peers_without_node(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert peers.install(Console(quiet=True)) is None
    everyone = tuple(range(os.cpu_count() or 1))
    bench = Bench(3.0, None, everyone, everyone, Console(quiet=True))
    figures = peers.measure_ours(bench, peers.Work(rooms=2, rate=5, ramp=0.1), BARE)
    assert figures["cores used"] > 0 and figures["steps per second"] > 5


def test_viewer(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pygame")
    from benchmarks import viewer

    monkeypatch.setattr(viewer, "SEEKS", 3)
    viewer.main(["--steps", "150"])
    assert "150 steps" in capsys.readouterr().out


@pytest.mark.process
@pytest.mark.slow
def test_window_start() -> None:
    pytest.importorskip("pygame")
    from benchmarks import startup

    first, kitchen = startup.first_pictures(startup.COMMANDS["robotouille-client"])
    assert first == kitchen
    assert min(first) > 0


async def test_parts_of_a_step_are_measured(tmp_path: Path) -> None:
    rows = dict(await parts.measure(10, 2, tmp_path))
    assert len(rows) == 3 + len(parts.PARTS)
    assert all(seconds > 0 for seconds in rows.values())


@pytest.mark.browser
@pytest.mark.process
@pytest.mark.slow
def test_page_in_a_browser(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("playwright")
    from benchmarks import page

    if page.CHROMIUM is None:
        pytest.skip("needs chromium: apt install chromium")
    page.main(["--parts", "load", "play", "--times", "1", "--seconds", "1", "--hour", "100"])
    shown = capsys.readouterr().out
    assert "first picture" in shown and "heap after 60" in shown
