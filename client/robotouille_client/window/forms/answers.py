"""What comes next, as it is chosen on a screen, or on a card beside a kitchen."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Answer"]


class Answer(StrEnum):
    """What the shell does next. Answers that only one form has are words of its own, or the thing
    that was picked."""

    PLAY = "play"
    JOIN = "join"
    OPEN = "open"
    LOBBY = "lobby"
    REPLAYS = "replays"
    TUTORIAL = "tutorial"
    SETTINGS = "settings"
    MENU = "menu"

    STAY = "stay"
    """In the game that is being shown."""
    AGAIN = "again"
    NEXT = "next"
    """The next task."""
    WATCH = "watch"
    """What was played, as a replay."""
    VIDEO = "video"

    ASK_TO_QUIT = "ask to quit"
    QUIT = "quit"
    """Close the window."""
