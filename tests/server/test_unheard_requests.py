"""What a player asks for and nobody looks at is answered as ever, and recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from robotouille.episode import RejectionKind
from robotouille.replay import read_recording, rejection_kind
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import run


def act(seq: int, action: object, **fields: object) -> dict[str, object]:
    return {"type": "act", "seq": seq, "action": action, **fields}


async def join(client: Raw, code: str) -> dict[str, Any]:
    return await client.ask({"type": "join", "episode": code}, "joined")


def rejected(folder: Path) -> list[dict[str, Any]]:
    (file,) = folder.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    return [note for note in recording.notes() if note["note"] == "rejected"]


def test_too_early_too_old_and_unreadable(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada, raw(server, name="bob") as bob:
            options = {"task": "multi_agent/01", "clock": "lockstep"}
            created = await ada.ask({"type": "create", **options}, "created")
            await join(ada, created["code"])
            early = await ada.ask(act(1, "juggle", reasoning="at once"), "rejected")
            assert early["code"] == "episode/waiting"
            await join(bob, created["code"])
            room = server.lobby.find(created["code"])
            assert room.episode.running
            bad = await ada.ask(act(7, "juggle"), "rejected")
            assert bad["code"] == "action/unknown"
            old = await ada.ask(act(3, "walk", reasoning="late"), "rejected")
            assert (old["seq"], old["code"], old["action"]) == (3, "action/stale", "walk")
            assert room.episode.seat("robot1").answer.seq == 7, "the last action is another"
            wrong = await ada.ask(act(8, {"nme": "walk"}), "error")
            assert wrong["code"].startswith("message/")
            tally = room.episode.seat("robot1").tally
            assert (tally.rejected, tally.invalid, tally.malformed) == (4, 0, 2)
            room.abort("seen")

    run(main())
    notes = rejected(tmp_path)
    assert [note["code"] for note in notes[:3]] == [
        "episode/waiting",
        "action/unknown",
        "action/stale",
    ]
    assert [rejection_kind(note) for note in notes] == [
        RejectionKind.UNHEARD,
        RejectionKind.MALFORMED,
        RejectionKind.UNHEARD,
        RejectionKind.MALFORMED,
    ]
    assert [note.get("heard", True) for note in notes] == [False, True, False, False]
    assert [note.get("reasoning") for note in notes[:3]] == ["at once", None, "late"]
    assert (notes[3]["seq"], "nme" in notes[3]["action"]) == (0, True)
    assert all(note["reasons"] for note in notes)


def test_one_too_many(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, messages_per_second=10) as server, raw(server) as ada:
            options = {"task": "synchronous/01", "clock": "lockstep"}
            created = await ada.ask({"type": "create", **options}, "created")
            await join(ada, created["code"])
            codes = []
            for seq in range(1, 100):
                codes.append((await ada.ask(act(seq, "juggle"), "rejected"))["code"])
            assert "rate/limited" in codes
            server.lobby.find(created["code"]).abort("seen")
            return_codes.extend(codes)

    return_codes: list[str] = []
    run(main())
    assert [note["code"] for note in rejected(tmp_path)] == return_codes
