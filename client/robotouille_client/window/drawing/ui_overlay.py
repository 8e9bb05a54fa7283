"""What a window adds to an episode's view: its owner's pointer, words and questions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["ActionMark", "KeyRows", "UiOverlay"]

KeyRows = tuple[tuple[str, str], ...]
"""Keys, and what each of them does."""


@dataclass(frozen=True, slots=True)
class ActionMark:
    """The station that the owner's newest action is about, and what became of the action."""

    station: str
    fate: Literal["asked", "done", "refused"]


@dataclass(frozen=True, slots=True)
class UiOverlay:
    """What only the owner of a window sees.

    `tips` are lines beside the mouse, `prompt` a line under the kitchen for a while, `typing` the
    chat line that is being typed (None when there is none), `help` rows of (key, meaning), if
    shown.

    The strip of keys under the kitchen has `hints`, rows of (key, what it does now), then `keys`,
    which are always there, and `queued`, what waits to be done. `choices` are the numbered actions
    of the open list, `chosen` the marked one of them; there is a `more` where the list goes on.
    """

    pointer: tuple[int, int] | None = None
    tips: tuple[str, ...] = ()
    prompt: str = ""
    typing: str | None = None
    help: KeyRows = ()
    hints: KeyRows = ()
    keys: KeyRows = ()
    queued: tuple[str, ...] = ()
    mark: ActionMark | None = None
    choices: tuple[str, ...] | None = None
    chosen: int = 0
    more: str = ""
