"""Reasons of steps as earlier versions recorded them: the same facts, in other words."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from robotouille.protocol.states import unmet_rows
from robotouille.world.unmet import earlier_words
from robotouille.world.world import Attempt

__all__ = ["as_recorded"]


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
