"""Controllers of each seat in each step of a recording, and the export as lines of JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from robotouille.errors import RecordingError
from robotouille.replay.measures import activities, controller_of, rejection_kind
from robotouille.replay.recording import Recording
from robotouille.world.world import State


@dataclass(frozen=True, slots=True)
class Seating:
    """Participant and controller of a seat. The name is empty if the seat is free."""

    name: str = ""
    kind: str = ""
    controller: str = ""


@dataclass(frozen=True, slots=True)
class Span:
    """Steps from `first` to `last` in which a seat had one participant and one controller."""

    player: str
    name: str
    controller: str
    first: int
    last: int


def controllers(recording: Recording) -> dict[int, dict[str, str]]:
    """Return the controllers of all players by step; see `Controller` for the values.

    An action that arrived before the connection was lost may be taken while the seat is `absent`
    or a `substitute`'s. Its sequence number is above 0; that of a substitute's action is 0.
    """
    return {
        step: {player: seating.controller for player, seating in seats.items()}
        for step, seats in seatings(recording)
        if step > 0
    }


def spans(recording: Recording) -> dict[str, list[Span]]:
    """Return each player's spans of steps with one controller."""
    found: dict[str, list[Span]] = {player: [] for player in recording.world.players}
    for step, seats in seatings(recording):
        if step == 0:
            continue
        for player, seating in seats.items():
            course, name, controller = found[player], seating.name, seating.controller
            if course and (course[-1].name, course[-1].controller) == (name, controller):
                course[-1] = replace(course[-1], last=step)
            else:
                course.append(Span(player, name, controller, step, step))
    return found


def seatings(recording: Recording) -> Iterator[tuple[int, Mapping[str, Seating]]]:
    """Yield the seats before the first step (as step 0), then in each step."""
    # Replaced and never changed: the caller may keep each mapping that this function yields.
    seats: dict[str, Seating] = dict.fromkeys(recording.world.players, Seating())
    begun = False
    for frame in recording.each_frame(states=False):
        if frame["kind"] == "notes":
            seats = {**seats, **dict(_changes(frame["notes"], seats))}
        elif frame["kind"] == "step":
            if not begun:
                yield 0, seats
            begun = True
            yield frame["step"], seats
    if not begun:
        yield 0, seats


def _changes(
    notes: list[dict[str, Any]], seats: Mapping[str, Seating]
) -> Iterator[tuple[str, Seating]]:
    for note in notes:
        if note["note"] == "roster" and note["player"] in seats:
            yield note["player"], seating_after(note)


def seating_after(note: Mapping[str, Any]) -> Seating:
    """Return a seat as in a `roster` note.

    Raises:
        RecordingError: The controller is unknown.
    """
    name = note["name"] if note["taken"] else ""
    return Seating(name, note["kind"], controller_of(note).value)


EXPORTED: Mapping[str, Mapping[str, str]] = {
    "header": {
        "…": "all fields of the [header](recording_format.md#header) except `tables`",
        "participants": "`name` and `kind` of each seat's last participant, by player",
    },
    "note": {
        "note": "the [note](recording_format.md#notes), with all its fields",
        "rejection": "of a `rejected` note: its [kind](recording_format.md#rejections)",
    },
    "step": {
        "step": "number of the step, from 1",
        "ms": "milliseconds from the start until the step was due (`t` in the recording)",
        "late": "milliseconds from then until the step was taken",
        "moves": "the [moves](recording_format.md#step) in order; `action` is the action's name, "
                 "`args` are its arguments, and `text` is its sentence",
        "rejected": "`unmet` of the recording: unmet preconditions by position in `moves`",
        "waits": "players who declared that they wait",
        "added": "facts that became true: predicate, then objects",
        "removed": "facts that became false",
        "undone": "facts that chance reverted; absent without chance",
        "hash": "[digest](episodes.md#state-digest) of the state after the step",
        "controllers": "who moved each seat, by player",
        "activities": "[activity](recording_format.md#activities) of each seat, by player",
        "busy": "steps for which players were still busy when the step began, by player",
        "observations": "with `--texts`: the text view of the state after the step, by player",
    },
    "outcome": {
        "…": "all fields of the [outcome](messages.md#outcomerow), such as `reason` and `seats`"
    },
}  # fmt: skip
"""Fields of each kind of exported line, after `kind`, for docs/recordings.md."""


def json_lines(recording: Recording, *, texts: bool = False) -> Iterator[str]:
    """Yield the header, steps, notes and outcome of a recording as lines of JSON.

    `EXPORTED` describes their fields.

    Args:
        texts: True to add the observation text of each seat to each step.
    """
    head = {key: value for key, value in recording.header.items() if key != "tables"}
    head["participants"] = {
        player: {"name": name, "kind": kind}
        for player, (name, kind) in recording.participants.items()
    }
    yield _line(head)
    in_control = seatings(recording)
    next(in_control)
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
            _, seats = next(in_control)
            controlled = {player: seating.controller for player, seating in seats.items()}
            yield _line({**row, "controllers": controlled, **told})
            before = state
        elif frame["kind"] == "footer":
            yield _line({"kind": "outcome", **frame["outcome"]})


def _step(
    recording: Recording, frame: dict[str, Any], before: State, state: State, texts: bool
) -> dict[str, Any]:
    added, removed = state.world.changes(before, state)
    row: dict[str, Any] = {
        "kind": "step",
        "step": frame["step"],
        "ms": frame["t"],
        "late": frame.get("late", 0),
        "moves": [
            {**move, "action": action.name, "args": action.arguments, "text": action.sentence}
            for move, action in zip(frame["moves"], recording.actions(frame), strict=True)
        ],
        "rejected": frame.get("unmet", {}),
        "waits": frame.get("waits", []),
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
        raise RecordingError(f"a value cannot be written as JSON: {error}") from None
