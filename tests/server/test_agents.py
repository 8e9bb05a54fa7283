"""The program that plays a seat is recorded, and nobody else learns it."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille.protocol.messages import Create
from robotouille.replay import read_recording
from robotouille_client.bots.kinds import BotKind, BotSetup
from robotouille_client.bots.seat_session import SeatRequest, play_seat
from robotouille_client.client import connect
from tests.support.servers import serving
from tests.support.virtual_time import virtual


@virtual
async def test_agent_is_recorded_and_hidden(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    async with serving(tmp_path / "recordings") as server:
        room = server.lobby.create(Create(task="synchronous/01", max_steps=3))
        async with connect(server.url, name="eve") as eve:
            watched = await eve.join(room.code, role="spectator")
            setup = BotSetup(BotKind.PLANNER, seed=7, skill="learner")
            await play_seat(SeatRequest(server.url, ("ada",), episode=room.code), setup)
            seen = [repr(event) async for event in watched]
            assert "ada" in repr(watched.seats)
            assert "learner" not in repr((seen, watched.seats, watched.outcome))
    (path,) = (tmp_path / "recordings").glob("*.rbt")
    recording = read_recording(path)
    assert recording.verify().ok
    agents = [note["agent"] for note in recording.notes() if note.get("agent")]
    assert agents[0].startswith("planner skill=learner reaction=1.0 pace=1.2")
    assert agents[0].endswith("seed=7")
