"""Notes in recordings on when models think, and the thoughts that they describe."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

TOPIC = "thinking"


class AnswerFate(StrEnum):
    """Use that a seat made of an answer, before the world applied or rejected it."""

    USED = "used"
    DROPPED = "dropped"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Thought:
    """Period in which a seat's model thought.

    `basis` is the step that it was shown. `arrived` is the step of its answer, or None if there was
    none. `dropped` is the action that came too late.
    """

    seat: str
    basis: int
    arrived: int | None = None
    dropped: str = ""


def begun_note(basis: int) -> str:
    """Return the note for a model that is asked about the state of step `basis`."""
    return json.dumps({"basis": basis})


def ended_note(basis: int, fate: AnswerFate, action: str = "") -> str:
    """Return the note for the answer about step `basis`."""
    details = {"action": action} if fate is AnswerFate.DROPPED else {}
    return json.dumps({"basis": basis, "fate": fate.value, **details}, ensure_ascii=False)


def thoughts(notes: Iterable[Mapping[str, Any]]) -> tuple[Thought, ...]:
    """Return all thoughts that the notes of a recording describe, in order."""
    found: list[Thought] = []
    open_: dict[str, int] = {}
    for note in notes:
        row = _row(note)
        if row is None:
            continue
        seat = str(note["player"])
        if "fate" not in row:
            open_[seat] = len(found)
            found.append(Thought(seat, row["basis"]))
        elif seat in open_ and found[open_[seat]].basis == row["basis"]:
            at = open_.pop(seat)
            dropped = str(row.get("action", ""))
            found[at] = replace(found[at], arrived=int(note["step"]), dropped=dropped)
    return tuple(found)


def _row(note: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the content of a note, or None if this module did not write it."""
    if note["note"] != "noted" or note["topic"] != TOPIC:
        return None
    try:
        row = json.loads(note["text"])
    except ValueError:
        return None
    # Recordings come from anyone; `type` because bool is an int.
    if not isinstance(row, dict) or type(row.get("basis")) is not int:
        return None
    return row if 0 <= row["basis"] <= note["step"] else None
