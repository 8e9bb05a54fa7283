"""Export a recording as JSON lines: an object for the header, each step, note and the outcome."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from robotouille.errors import RecordingError
from robotouille.replay.analysis.activities import activities
from robotouille.replay.controllers import controllers
from robotouille.replay.notes import rejection_kind
from robotouille.replay.recording import Recording
from robotouille.world.world import State

__all__ = ["json_lines"]


def json_lines(recording: Recording, *, texts: bool = False) -> Iterator[str]:
    """The lines; seats are in seat order. Each step says who moved the seats (`controllers`), what
    they did with it (`activities`) and for how many steps from its beginning on some could not act
    (`busy`); with `texts` also what each seat read. A note of what was rejected has its kind as
    `rejection`: a `RejectionKind`."""
    head = {key: value for key, value in recording.header.items() if key not in ("tables",)}
    head["participants"] = {
        player: {"name": name, "kind": kind}
        for player, (name, kind) in recording.participants.items()
    }
    yield _line(head)
    in_control = controllers(recording)
    each_activity = activities(recording)
    states = recording.states()
    before = next(states)[1]
    for frame in recording.each_frame():
        if frame["kind"] == "notes":
            for note in frame["notes"]:
                kind = {"rejection": rejection_kind(note)} if note["note"] == "rejected" else {}
                yield _line({"kind": "note", "note": note, **kind})
        elif frame["kind"] == "step":
            state = next(states)[1]
            row = _step(recording, frame, before, state, texts)
            _, did = next(each_activity)
            told = {"activities": did.did, "busy": did.busy}
            yield _line({**row, "controllers": in_control[frame["step"]], **told})
            before = state
        elif frame["kind"] == "footer":
            yield _line({"kind": "outcome", **_outcome(recording, frame["outcome"])})


def _outcome(recording: Recording, outcome: dict[str, Any]) -> dict[str, Any]:
    """The outcome; what the seats did with the steps is counted anew, as earlier versions did not
    count it all."""
    counted = recording.measures().seats
    seats = []
    for row in outcome.get("seats", ()):
        told = {key: value for key, value in row.items() if key != "applied"}
        if row["player"] in counted:
            told |= counted[row["player"]].activities
        seats.append(told)
    return {**outcome, "seats": seats}


def _step(
    recording: Recording, frame: dict[str, Any], before: State, state: State, texts: bool
) -> dict[str, Any]:
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
        "hash": state.digest,
    }
    if "undone" in frame:
        row["undone"] = frame["undone"]
    if texts:
        row["observations"] = {p: state.text_view(p) for p in state.world.players}
    return row


def _line(row: dict[str, Any]) -> str:
    try:
        return json.dumps(row, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise RecordingError(f"has a value that JSON cannot carry: {error}") from None
