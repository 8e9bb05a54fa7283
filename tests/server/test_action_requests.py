"""An action that comes again, since its answer may be lost, is answered again and acts once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robotouille.replay.recording import read_recording
from robotouille_server import Server
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import run


def move(seq: int, start: str, end: str) -> dict[str, Any]:
    """The cook stands at table3 at first: from anywhere else it is impossible."""
    return {"type": "act", "seq": seq, "action": {"name": "move", "args": ["robot1", start, end]}}


async def enter(server: Server, ada: Raw, clock: str) -> None:
    """Play alone."""
    create = {"type": "create", "task": "synchronous/01", "clock": clock}
    created = await ada.ask(create, "created")
    await ada.ask({"type": "join", "episode": created["code"]}, "joined")
    await ada.expect("snapshot")


@pytest.mark.parametrize("clock", ["turn", "lockstep", "realtime"])
def test_a_rejection_is_told_again_and_happens_once(tmp_path: Path, clock: str) -> None:
    """What is asked afterwards is answered after it: so `said` would come if nothing else did."""

    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada:
            await enter(server, ada, clock)
            impossible = move(1, "table1", "table2")
            first = await ada.ask(impossible, "rejected")
            assert first["seq"] == 1
            assert first["reasons"]
            for _ in range(2):
                await ada.send(impossible)
                again = await ada.ask({"type": "say", "text": "well?"}, "rejected", "said")
                assert again["type"] == "rejected", "it was not answered again"
                await ada.expect("said")
                told = ("seq", "step", "reasons")
                assert [again[key] for key in told] == [first[key] for key in told]
            assert server.metrics.rejected == 1
            await ada.send(move(2, "table3", "table1"))
            while 2 not in (await ada.expect("delta", "rejected")).get("seq", []):
                pass

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    assert len([note for note in recording.notes() if note["note"] == "rejected"]) == 1
    moves = [move for step in recording.steps for move in step.get("moves", ())]
    assert [move["seq"] for move in moves] == [2]


def test_a_deed_is_shown_again_and_done_once(tmp_path: Path) -> None:
    """There and back, and the first way again: the cook stays where the second has led."""

    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada:
            await enter(server, ada, "lockstep")
            there = move(1, "table3", "table1")
            assert (await ada.ask(there, "delta"))["step"] == 1
            await ada.send(there)
            again = await ada.ask({"type": "say", "text": "well?"}, "snapshot", "delta", "said")
            assert (again["type"], again["step"], again["seq"]) == ("snapshot", 1, 1)
            assert (await ada.ask(move(2, "table1", "table3"), "delta"))["step"] == 2
            stale = await ada.ask(there, "rejected", "delta")
            assert (stale["type"], stale["code"]) == ("rejected", "action/stale")

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    moves = [move for step in read_recording(file).steps for move in step.get("moves", ())]
    assert [move["seq"] for move in moves] == [1, 2]


@pytest.mark.parametrize(
    ("basis", "told"),
    [
        (None, "a position needs the step whose list it is in, as 'basis'; it is step 1"),
        (0, "step 0 is past; it is step 1"),
        (99, "step 99 is still to come; it is step 1"),
    ],
)
def test_a_position_in_the_list_of_another_step_is_stale(
    tmp_path: Path, basis: int | None, told: str
) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada:
            await enter(server, ada, "lockstep")
            await ada.ask({"type": "act", "seq": 1, "action": None}, "delta")
            act = {"type": "act", "seq": 2, "action": 0, "basis": basis}
            rejected = await ada.ask(act, "rejected")
            assert (rejected["code"], rejected["reasons"]) == ("action/stale", [told])

    run(main())
