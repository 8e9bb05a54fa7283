"""A seat that asks for what cannot be done is told what is unmet, and the recording has it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from robotouille.replay.notes import rejections
from robotouille.replay.recording import read_recording
from robotouille.world.sentences import MAX_SENTENCE
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import run

BAD = "Put down cheese1 at table1 with robot1"


async def seated(client: Raw) -> dict[str, Any]:
    """The first observation of a game of one, in the text view."""
    options = {"task": "synchronous/01", "clock": "turn", "max_steps": 1}
    created = await client.ask({"type": "create", **options}, "created")
    join = {"type": "join", "episode": created["code"], "view": "text"}
    await client.ask(join, "joined")
    first = await client.expect("observation")
    while (await client.expect("roster"))["phase"] != "running":
        pass
    return first


def act(seq: int, action: object, **fields: object) -> dict[str, object]:
    return {"type": "act", "seq": seq, "action": action, **fields}


def test_what_is_unmet_is_told_of_sentences_as_of_action_objects(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada:
            await seated(ada)
            sentence = await ada.ask(act(1, BAD), "rejected")
            named = {"name": "place-item", "args": ["robot1", "cheese1", "table1"]}
            thing = await ada.ask(act(2, named), "rejected")
            assert {**sentence, "seq": 2} == thing
            assert "code" not in sentence
            condition = {"kind": "condition", "predicate": "has_item"}
            assert {**condition, "objects": ["robot1", "cheese1"]} in sentence["why"]
            again = await ada.ask(act(2, BAD), "rejected")
            assert again["reasons"] == sentence["reasons"]

    run(main())


def test_every_request_is_answered_once_recorded_and_counted(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada:
            first = await seated(ada)
            long = "pizza " * (MAX_SENTENCE // 6)
            requests = ["Boil the sea", long, {"name": "fly", "args": []}, 999]
            for seq, request in enumerate(requests, 1):
                for _ in range(2):
                    sent = act(seq, request, basis=0, reasoning=f"thought {seq}")
                    answer = await ada.ask(sent, "rejected")
                    assert (answer["seq"], answer["code"]) == (seq, "action/unknown")
                    assert "why" not in answer
            stale = await ada.ask(act(5, 0, basis=7), "rejected")
            assert stale["code"] == "action/stale"
            await ada.expect("observation")
            await ada.ask(act(6, BAD, reasoning="thought 6"), "rejected")
            await ada.send(act(7, f"({first['actions'][0].lower()})."))
            outcome = (await ada.expect("ended"))["outcome"]
            (seat,) = outcome["seats"]
            assert (seat["acted"], seat["rejected"]) == (1, 6)
            assert (seat["invalid"], seat["malformed"]) == (2, 4)

    run(main())
    recording = read_recording(next(tmp_path.rglob("*.rbt")))
    assert recording.verify().ok
    found = [note for note in recording.notes() if note["note"] == "rejected"]
    assert [note["action"][:12] for note in found] == [
        "Boil the sea", "pizza pizza ", "fly()", "999", "0", BAD[:12],
    ]  # fmt: skip
    assert [note.get("reasoning", "") for note in found] == [
        "thought 1", "thought 2", "thought 3", "thought 4", "", "thought 6",
    ]  # fmt: skip
    assert rejections(recording) == {"robot1": {"invalid": 2, "malformed": 4}}
