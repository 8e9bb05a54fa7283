"""A line of text that can be edited."""

from __future__ import annotations

from collections.abc import Callable

import pygame

from robotouille_client.window.forms.widgets import Look, Row
from robotouille_client.window.hands.commands import Command
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.theme import INK, PAPER, mixed

__all__ = ["TextField"]

_CARET = "|"


class TextField(Row):
    """A line of text of at most `length` letters; `changed` is told each new one.

    With `replaced`, all of it is selected when the field gets the focus, so that what is typed
    takes its place; a second click is for those who want to edit it.

    Arrows, Home and End move the caret; with Ctrl, A selects all, C copies, X cuts and V pastes.
    """

    wants_letters = True

    def __init__(
        self,
        label: str,
        text: str = "",
        length: int = 40,
        hint: str = "",
        changed: Callable[[str], None] | None = None,
        *,
        replaced: bool = False,
    ) -> None:
        super().__init__(label)
        self.text = text[:length]
        self.selected = False
        self._caret = len(self.text)
        self._length = length
        self._hint = hint
        self._changed = changed
        self._replaced = replaced

    def draw(self, target: pygame.Surface, area: pygame.Rect, look: Look) -> None:
        super().draw(target, area, look)
        room = max(look.size * 4, area.width - look.text.width(self.label, look.size) * 3 // 2)
        if look.focused and self.selected and self.text:
            plate = pygame.Rect(0, 0, 0, round(look.size * 1.6))
            plate.width = min(room, look.text.width(self.text, look.size)) + look.size
            plate.midright = (area.right - look.size // 2, area.centery)
            target.blit(box(plate.size, mixed(PAPER, INK, 0.1), look.size // 3), plate)
        self._right(target, area, look, self._shown(look, room))

    def gained_focus(self) -> None:
        self.selected = self._replaced and bool(self.text)

    def letters(self, text: str) -> None:
        typed = "".join(letter for letter in text if letter.isprintable())
        if not typed:
            return
        if self.selected:
            self._set("", 0)
        typed = typed[: self._length - len(self.text)]
        self._set(
            self.text[: self._caret] + typed + self.text[self._caret :], self._caret + len(typed)
        )

    def key(self, name: str, *, ctrl: bool = False) -> bool:
        if ctrl:
            return self._shortcut(name)
        if name in ("backspace", "delete"):
            self._erase(name)
        elif name in ("left", "right", "home", "end"):
            steps = {"left": self._caret - 1, "right": self._caret + 1, "home": 0}
            self._set(self.text, steps.get(name, len(self.text)))
        else:
            return False
        return True

    def command(self, command: Command) -> bool:
        return command is Command.ENTER

    def click(self, share: float) -> bool:
        edits = not self._replaced or self.selected
        self._set(self.text, len(self.text))
        self.selected = not edits and bool(self.text)
        return False

    def _shortcut(self, name: str) -> bool:
        if name == "a":
            self.selected = bool(self.text)
        elif name == "v":
            self.letters(_clipboard())
        elif name in ("c", "x"):
            _copy(self.text)
            if name == "x":
                self._set("", 0)
        else:
            return False
        return True

    def _erase(self, name: str) -> None:
        before, after = self.text[: self._caret], self.text[self._caret :]
        if self.selected:
            self._set("", 0)
        elif name == "backspace":
            self._set(before[:-1] + after, self._caret - 1)
        else:
            self._set(before + after[1:], self._caret)

    def _set(self, text: str, caret: int) -> None:
        new = text != self.text
        self.text = text
        self._caret = min(len(text), max(0, caret))
        self.selected = False
        if new and self._changed is not None:
            self._changed(text)

    def _shown(self, look: Look, room: int) -> str:
        """The part around the caret that has room."""
        if not look.focused:
            return self.text or self._hint
        if self.selected:
            return self.text
        start = 0
        before, after = self.text[: self._caret], self.text[self._caret :]
        while look.text.width(f"…{before[start:]}{_CARET}", look.size) > room and before[start:]:
            start += 1
        return f"{'…' if start else ''}{before[start:]}{_CARET}{after}"


def _clipboard() -> str:
    """The text that was copied anywhere; empty where there is none, or no clipboard."""
    try:
        return str(pygame.scrap.get_text()).strip()
    except pygame.error:
        return ""


def _copy(text: str) -> None:
    try:
        pygame.scrap.put_text(text)
    except pygame.error:
        return
