"""Who moves a seat, as the notes of a recording tell it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robotouille.episode.lifecycle import Controller
from robotouille.errors import RecordingError

__all__ = ["controller_after"]


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
