"""Streaming with real LSL outlets and inlets on one machine."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest

from robotouille_client import Client, Game, connect
from robotouille_client.errors import ConnectionFailedError
from robotouille_client.lsl import Outlets, main, stream
from tests.support.servers import serving
from tests.support.virtual_time import virtual

MACHINE = "[multicast]\nResolveScope = machine\n[ports]\nIPv6 = disable\n[log]\nlevel = -2\n"
"""Settings that keep LSL from using the network."""


class Kept:
    """Outlet that keeps its samples."""

    def __init__(self) -> None:
        self.samples: list[list[Any]] = []

    def push_sample(self, x: list[Any], timestamp: float) -> None:
        self.samples.append(x)


@virtual
async def test_spectator_streams_an_episode_to_its_end(tmp_path: Path) -> None:
    steps, events, opened = Kept(), Kept(), asyncio.Event()

    def opening(game: Game, offsets: list[float]) -> Outlets:
        assert offsets
        opened.set()
        return Outlets(steps, events, lambda: 0.0)

    async with serving(tmp_path, max_steps=6) as server:
        async with (
            connect(server.url, name="ada") as ada,
            connect(server.url, name="lsl") as watcher,
        ):
            played = await ada.join((await ada.create("synchronous/01")).code)
            streaming = asyncio.create_task(stream(watcher, played.episode, opening))
            await opened.wait()
            while not played.ended:
                await played.act(played.actions[0] if played.actions else None)
            game = await streaming
    assert game.outcome is not None
    assert [row[0] for row in steps.samples][-6:] == [1, 2, 3, 4, 5, 6]
    received = [json.loads(row[0]) for row in events.samples]
    assert received[-1] == {"step": 6, "event": "ended", "reason": "step_limit"}
    assert sum(row["event"] == "action" for row in received) >= 5


@virtual
async def test_round_trip_needs_a_connection() -> None:
    with pytest.raises(ConnectionFailedError):
        await Client("ws://127.0.0.1:1", name="ada").round_trip()


def test_missing_library_is_explained(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pylsl", None)
    monkeypatch.setattr(sys, "argv", ["robotouille-lsl", "ABCDE-FGHJK"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 1
    assert "pip install 'robotouille[lsl]'" in capsys.readouterr().err


PROGRAM = """
import json, sys, pylsl
from robotouille_client.lsl import open_outlets
from robotouille_client.sansio.game_events import Announced, StateChanged
from robotouille import World

world = World("synchronous/01")
outlets = open_outlets(pylsl, "ad9a", "synchronous/01", "ws://here", [0.002, 0.004])
inlets = []
for what in ("steps", "events"):
    found = pylsl.resolve_byprop("source_id", f"robotouille-ad9a-{what}", 1, 20)
    if not found:
        sys.exit(77)
    inlets.append(pylsl.StreamInlet(found[0]))
    inlets[-1].open_stream(20)
action = world.initial.actions("robot1")[0]
before = pylsl.local_clock()
for step in (1, 2, 3):
    outlets.push(StateChanged(step, world.initial, None, (("robot1", action, True),)), step, 0.5)
after = pylsl.local_clock()
rows = []
for inlet in inlets:
    rows.append([inlet.pull_sample(20) for _ in range(3)])
print(json.dumps({"rows": rows, "between": [before, after],
                  "about": inlets[0].info(20).as_xml()}))
"""


@pytest.mark.process
@pytest.mark.slow
def test_inlet_receives_the_samples_of_an_outlet(tmp_path: Path) -> None:
    pytest.importorskip("pylsl")
    (tmp_path / "lsl_api.cfg").write_text(MACHINE)
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "LSLAPICFG": str(tmp_path / "lsl_api.cfg")},
        capture_output=True,
        text=True,
        timeout=120,
    )
    if result.returncode == 77:
        pytest.skip("LSL finds nothing on this machine: it has no multicast")
    assert result.returncode == 0, result.stderr
    received = json.loads(result.stdout)
    steps, events = received["rows"]
    assert [sample for sample, _ in steps] == [[n, 1, 0, 500] for n in (1, 2, 3)]
    assert [json.loads(sample[0])["step"] for sample, _ in events] == [1, 2, 3]
    before, after = received["between"]
    stamps = [stamp for _, stamp in steps]
    assert stamps == [stamp for _, stamp in events]
    assert all(before - 0.5 <= stamp <= after - 0.5 for stamp in stamps)
    about = ElementTree.fromstring(received["about"])
    assert [each.text for each in about.iter("label")][0] == "step"
    assert float(about.find(".//synchronization/offset_mean").text) == 0.003  # type: ignore
