"""What the notes of a recording say: what was asked for and taken into no step, and who moves a
seat."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from robotouille.episode.events import ACTION_INVALID, RejectionKind
from robotouille.episode.lifecycle import Controller
from robotouille.errors import RecordingError
from robotouille.protocol.states import unmet_rows
from robotouille.replay.frame_schema import FrameSource
from robotouille.world.unmet import Attempt, earlier_words, from_words

__all__ = ["as_recorded", "controller_after", "rejection_kind", "rejections"]


def rejection_kind(note: Mapping[str, Any]) -> RejectionKind:
    """What a `rejected` note rejects; notes of earlier versions say it by their reasons alone."""
    reasons, heard = from_words(*note["reasons"]), note.get("heard", True)
    return RejectionKind.of(note.get("code", ACTION_INVALID), reasons, heard=heard)


def rejections(recording: FrameSource) -> dict[str, Counter[RejectionKind]]:
    """What of each player was rejected how often, by kind: also in a recording that has no end, or
    is older than the counts in its outcome."""
    counts: dict[str, Counter[RejectionKind]] = {
        player: Counter() for player in recording.world.players
    }
    for note in recording.notes():
        if note["note"] == "rejected":
            counts.setdefault(note["player"], Counter())[rejection_kind(note)] += 1
    return counts


def controller_after(note: Mapping[str, Any]) -> Controller:
    """Who moves a seat from a `roster` note on; those of earlier versions do not say it.

    Raises:
        RecordingError: It names a controller that is not known.
    """
    if "controller" in note or note["present"]:
        try:
            return Controller(note.get("controller", note["kind"]))
        except ValueError as error:
            raise RecordingError(str(error)) from None
    return Controller.ABSENT if note["name"] and note.get("taken", True) else Controller.FREE


def as_recorded(frame: dict[str, Any], attempts: tuple[Attempt, ...]) -> tuple[Attempt, ...]:
    """The attempts of a step, with the words that the frame has for them where these are the ones
    that earlier versions used."""
    if "unmet" not in frame or frame["unmet"] == unmet_rows(attempts):
        return attempts
    earlier = tuple(map(_in_earlier_words, attempts))
    return earlier if frame["unmet"] == unmet_rows(earlier) else attempts


def _in_earlier_words(attempt: Attempt) -> Attempt:
    unmet = tuple(replace(each, words=earlier_words(each.words)) for each in attempt.unmet)
    return attempt._replace(unmet=unmet)
