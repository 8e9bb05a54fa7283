"""Meaning of single notes: the kind of a rejection, and the controller of a seat."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from robotouille.episode.events import ACTION_INVALID, RejectionKind
from robotouille.episode.lifecycle import Controller
from robotouille.errors import RecordingError
from robotouille.replay.frame_schema import FrameSource
from robotouille.world.unmet import unmet_from


def rejection_kind(note: Mapping[str, Any]) -> RejectionKind:
    """Return the kind of a `rejected` note."""
    reasons = unmet_from(note["reasons"], note.get("why", ()))
    code, heard = note.get("code", ACTION_INVALID), note.get("heard", True)
    # Computed by the same function as during play, because recordings do not store the kind.
    return RejectionKind.of(code, reasons, heard=heard)


def rejections(recording: FrameSource) -> dict[str, Counter[RejectionKind]]:
    """Count each player's rejected requests by kind. The recording need not have an end."""
    counts: dict[str, Counter[RejectionKind]] = {
        player: Counter() for player in recording.world.players
    }
    for note in recording.notes():
        if note["note"] == "rejected":
            counts.setdefault(note["player"], Counter())[rejection_kind(note)] += 1
    return counts


def controller_of(note: Mapping[str, Any]) -> Controller:
    """Return the controller in a `roster` note.

    Raises:
        RecordingError: The controller is unknown.
    """
    try:
        return Controller(note["controller"])
    except ValueError as error:
        raise RecordingError(str(error)) from None
