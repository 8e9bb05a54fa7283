"""What was asked for in a recording and taken into no step."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from robotouille.episode.events import ACTION_INVALID, Verdict
from robotouille.replay.recording import Recording
from robotouille.world.unmet import from_words

__all__ = ["refusals", "verdict"]


def verdict(note: Mapping[str, Any]) -> Verdict:
    """What a `rejected` note rejects; notes of earlier versions say it by their reasons alone."""
    return Verdict.of(note.get("code", ACTION_INVALID), from_words(*note["reasons"]))


def refusals(recording: Recording) -> dict[str, Counter[Verdict]]:
    """How often each player was refused what: also of a recording that has no end, or is older
    than the counts in its outcome."""
    counts: dict[str, Counter[Verdict]] = {player: Counter() for player in recording.world.players}
    for note in recording.notes():
        if note["note"] == "rejected":
            counts.setdefault(note["player"], Counter())[verdict(note)] += 1
    return counts
