"""Export a recording as JSON lines: one object for the header, each step and the outcome."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from robotouille.replay.recording import Recording

__all__ = ["json_lines"]


def json_lines(recording: Recording, *, texts: bool = False) -> Iterator[str]:
    """The lines; with `texts`, each step has the observation in words of every seat."""
    head = {key: value for key, value in recording.header.items() if key not in ("tables",)}
    head["participants"] = {
        player: {"name": name, "kind": kind}
        for player, (name, kind) in recording.participants.items()
    }
    yield _line(head)
    states = recording.states()
    before = next(states)[1]
    for frame, (_, state) in zip(recording.steps, states, strict=True):
        added, removed = state.world.changes(before, state)
        row: dict[str, Any] = {
            "kind": "step",
            "step": frame["step"],
            "ms": frame["t"],
            "moves": [
                {**move, "action": action.name, "args": action.arguments, "text": action.sentence}
                for move, action in zip(frame["moves"], recording.actions(frame), strict=True)
            ],
            "rejected": frame.get("unmet", {}),
            "added": [list(atom) for atom in added],
            "removed": [list(atom) for atom in removed],
            "notes": frame.get("notes", []),
            "hash": state.digest,
        }
        if texts:
            row["observations"] = {p: state.text(p) for p in state.world.players}
        yield _line(row)
        before = state
    if recording.outcome is not None:
        yield _line({"kind": "outcome", **recording.outcome})


def _line(row: dict[str, Any]) -> str:
    return json.dumps(row, separators=(",", ":"), ensure_ascii=False)
