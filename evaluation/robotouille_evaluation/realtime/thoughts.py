"""When models thought, in the notes of the seats that they play.

A note of the topic `thinking` is a JSON object. `basis` alone says that the model was shown that
step and is asked now; with `fate` that its answer has come: `used`, `dropped` (and then `action`),
or `none`, if no action was in it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

__all__ = ["TOPIC", "Fate", "Thought", "begun_note", "ended_note", "thoughts"]

TOPIC = "thinking"


class Fate(StrEnum):
    """What became of an answer, before the world had its say."""

    USED = "used"
    DROPPED = "dropped"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Thought:
    """A model of `seat` thought from step `basis` until its answer came at step `arrived`; None
    if it never came. `dropped` is the action that it was too late for."""

    seat: str
    basis: int
    arrived: int | None = None
    dropped: str = ""


def begun_note(basis: int) -> str:
    """A model was shown the state after so many steps, and is asked."""
    return json.dumps({"basis": basis})


def ended_note(basis: int, fate: Fate, action: str = "") -> str:
    """Its answer has come."""
    told = {"action": action} if fate is Fate.DROPPED else {}
    return json.dumps({"basis": basis, "fate": fate.value, **told}, ensure_ascii=False)


def thoughts(notes: Iterable[Mapping[str, Any]]) -> tuple[Thought, ...]:
    """All thoughts that notes of a recording tell of, in order; each note has its `step`."""
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
    """What a note says; None where it is another, or none that this module has written."""
    if note["note"] != "noted" or note["topic"] != TOPIC:
        return None
    try:
        row = json.loads(note["text"])
    except ValueError:
        return None
    if not isinstance(row, dict) or type(row.get("basis")) is not int:
        return None
    return row if 0 <= row["basis"] <= note["step"] else None
