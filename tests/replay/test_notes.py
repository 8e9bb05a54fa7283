"""Rejected requests: recorded with their texts, counted, and restored."""

from __future__ import annotations

import json
from typing import Any

import pytest

from robotouille import ProtocolError, RecordingError, World
from robotouille.episode import ActionRequest, Episode, Rules
from robotouille.replay.controllers import json_lines
from robotouille.replay.measures import controller_of, rejections
from robotouille.replay.recording import Recording
from tests.support.games import record

WORLD = World("synchronous/01")
BAD = "place-item(robot1, cheese1, table1)"


def recorded(*, ended: bool) -> tuple[Episode, bytes]:
    """Record eight requests of a model. Only the last one is a valid action."""
    rules = Rules(max_steps=9)
    episode = Episode(WORLD, rules)
    episode.join("robot1", "ada", "model", 0.0)
    for seq, text in enumerate(["Boil the sea", BAD, BAD, "", "🍕", "I do not know"], 1):
        episode.submit("robot1", ActionRequest(seq, text, reasoning=f"thought {seq}"), float(seq))
    episode.reject(
        "robot1", ActionRequest(7, "99"), ProtocolError("action/stale", "step 0 is past"), 7.0
    )
    episode.submit("robot1", ActionRequest(8, WORLD.initial.actions("robot1")[0].sentence), 8.0)
    if ended:
        episode.abort(9.0, "enough")
    return episode, record(episode, episode.events())


def notes(recording: Recording) -> list[dict[str, Any]]:
    return [note for note in recording.notes() if note["note"] == "rejected"]


def test_rejected_requests_are_recorded_with_text_reasoning_and_reasons() -> None:
    recording = Recording(recorded(ended=True)[1])
    assert recording.verify().ok
    found = notes(recording)
    assert [note.get("text", note["action"]) for note in found] == [
        "Boil the sea", BAD, BAD, "", "🍕", "I do not know", "99",
    ]  # fmt: skip
    assert [note.get("reasoning") for note in found[:6]] == [f"thought {i}" for i in range(1, 7)]
    assert [note.get("code", "") for note in found[::2]] == [
        "action/unknown", "", "action/unknown", "action/stale",
    ]  # fmt: skip
    assert found[1]["action"] == "Put down cheese1 at table1 with robot1"
    why = {"kind": "condition", "predicate": "has_item", "objects": ["robot1", "cheese1"]}
    assert why in found[1]["why"]
    assert len(found[1]["why"]) == len(found[1]["reasons"])
    assert "why" not in found[0]


def test_rejected_requests_are_counted_in_outcome_and_export() -> None:
    recording = Recording(recorded(ended=True)[1])
    assert recording.outcome is not None
    (seat,) = recording.outcome["seats"]
    assert (seat["acted"], seat["rejected"]) == (1, 7)
    assert (seat["invalid"], seat["malformed"]) == (3, 4)
    assert rejections(recording) == {"robot1": {"invalid": 3, "malformed": 4}}
    rows = [json.loads(line) for line in json_lines(recording)]
    kinds = [row["rejection"] for row in rows if "rejection" in row]
    assert kinds.count("invalid") == 3
    assert kinds.count("malformed") == 4


def test_unknown_controller_is_refused() -> None:
    with pytest.raises(RecordingError, match="ghost"):
        controller_of({"controller": "ghost"})
