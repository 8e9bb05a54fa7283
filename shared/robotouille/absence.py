"""What an episode does without a participant: by itself, so that command lines can name it."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Absence"]


class Absence(StrEnum):
    """What happens while a participant is away."""

    WAIT = "wait"
    PAUSE = "pause"
    BOT = "bot"
    END = "end"
