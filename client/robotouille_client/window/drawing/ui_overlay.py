"""What a window adds to an episode's view: its owner's pointer, words and questions."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["UiOverlay"]


@dataclass(frozen=True, slots=True)
class UiOverlay:
    """What only the owner of a window sees.

    `tips` are lines beside the mouse, `prompt` a line under the kitchen, `typing` the chat line
    that is being typed (None when there is none), `help` rows of (key, meaning), if shown.
    """

    pointer: tuple[int, int] | None = None
    tips: tuple[str, ...] = ()
    prompt: str = ""
    typing: str | None = None
    help: tuple[tuple[str, str], ...] = ()
