"""Notes are recorded and told to nobody."""

from __future__ import annotations

import asyncio
from pathlib import Path

from robotouille.replay.recording import read_recording
from robotouille.replay.timeline import note_lines
from robotouille_client import connect
from tests.support.servers import serving
from tests.support.virtual_time import run


def test_a_note_is_recorded_and_nobody_is_told(tmp_path: Path) -> None:
    text = "".join(chr(33 + n % 90) for n in range(20_000))

    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="ada") as ada,
            connect(server.url, name="bob") as bob,
            connect(server.url, name="eve") as eve,
        ):
            opened = await ada.create("multi_agent/01", clock="lockstep", max_steps=1)
            game = await ada.join(opened.code)
            other = await bob.join(opened.code)
            watching = await eve.join(opened.code, role="spectator")
            watching.note("plan", "spectators have none")
            game.note("plan", text)
            game.say("ready")
            await asyncio.gather(game.act(None), other.act(None))
            heard = [str(event) for each in (other, watching) for event in each.poll()]
            assert any("ready" in event for event in heard)
            assert not any(text[:100] in event for event in heard)

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    notes = [note for note in recording.notes() if note["note"] == "noted"]
    assert "".join(note["text"] for note in notes) == text
    assert [note.get("more", False) for note in notes] == [True, True, False]
    assert {(note["player"], note["topic"]) for note in notes} == {("robot1", "plan")}
    assert any("robot1 notes (plan): !" in line for line in note_lines(recording))
