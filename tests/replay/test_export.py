"""Recordings as lines of JSON."""

from __future__ import annotations

import json

from robotouille.replay.export import json_lines
from robotouille.replay.recording import Recording
from tests.support.games import recorded_game

GAME = recorded_game("multi_agent/10@3", seed=5, steps=30)


def test_export_is_json_lines_with_what_everybody_did() -> None:
    recording = Recording(GAME)
    lines = [json.loads(line) for line in json_lines(recording, texts=True)]
    assert (lines[0]["kind"], lines[-1]["kind"]) == ("header", "outcome")
    lines = [line for line in lines if line["kind"] == "step"]
    assert len(lines) == len(recording.steps)
    assert set(lines[1]["observations"]) == set(recording.world.players)
    assert lines[1]["moves"][0]["text"]
    assert {"added", "removed", "hash", "rejected"} <= lines[1].keys()
