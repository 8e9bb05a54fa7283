"""Rows of a form: buttons, choices, sliders, and fields for text and keys.

A row draws itself and handles commands, letters and clicks. It does not know the other rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import pygame

from robotouille_client.window.input.commands import Command, key_words
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    CARD,
    FAINT,
    INK,
    PAPER,
    TEXT,
    TRACK,
    mixed,
)

_DOUBLE = 5 / 2
"""Height of a focusable row, in text heights."""
_TRACK, _BESIDE = (0.4, 0.75), 0.08
"""Position of a slider's track in the row, and the width beside it that still counts as a hit."""


@dataclass(frozen=True, slots=True)
class DrawContext:
    """Text renderer, text size and focus with which a row is drawn.

    Attributes:
        age: Seconds for which the form has been shown; infinite if nothing in it moves.
    """

    text: Typesetter
    size: int
    focused: bool
    age: float = math.inf


class Row:
    """One row of a form.

    `answer` is the form's result if the row is chosen; None if the row has no result. `moves` is
    true if the row looks different while its card is new.
    """

    focusable = True
    moves = False
    wants_letters = False
    wants_keys = False
    answer: object = None

    def __init__(self, label: str) -> None:
        self.label = label

    def draw(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        self._plate(target, area, context)
        self._label(target, area, context)

    def lines(self, context: DrawContext, width: int) -> int:
        """Return the number of text lines at a width."""
        return 1

    def height(self, context: DrawContext, width: int) -> int:
        """Return the height in pixels at a width."""
        if self.focusable:
            return round(context.size * _DOUBLE)
        return self.lines(context, width) * context.text.height(context.size) + context.size // 2

    def command(self, command: Command) -> bool:
        """Run a command; return whether it chooses the row."""
        return False

    def gained_focus(self) -> None:
        """Handle receiving the focus."""

    def letters(self, text: str) -> None:
        """Handle typed letters."""

    def key(self, name: str, *, ctrl: bool = False) -> bool:
        """Handle a key before it counts as a command; return whether the row used it."""
        return False

    def point(self, share: float) -> None:
        """Handle the mouse at a share of the width."""

    def click(self, share: float) -> bool:
        """Handle a click at a share of the width; return whether it chooses the row."""
        return self.command(Command.USE)

    def _plate(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        fill = ACCENT if context.focused else CARD
        target.blit(box(area.size, fill, context.size // 2), area)

    def _label(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        words = context.text.fit(self.label, context.size, area.width - 2 * context.size)
        line = context.text.line(words, context.size, INK if context.focused else TEXT)
        target.blit(line, line.get_rect(midleft=(area.x + context.size, area.centery)))

    def _right(
        self, target: pygame.Surface, area: pygame.Rect, context: DrawContext, words: str
    ) -> pygame.Rect:
        """Draw words at the right end; return where they are."""
        used = context.text.width(self.label, context.size)
        room = max(context.size * 4, area.width - used - 4 * context.size)
        fitting = context.text.fit(words, context.size, room)
        line = context.text.line(fitting, context.size, INK if context.focused else FAINT)
        place = line.get_rect(midright=(area.right - context.size, area.centery))
        target.blit(line, place)
        return place


class Words(Row):
    """Text that cannot be changed."""

    focusable = False

    def draw(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        y = area.y + context.size // 3
        for words in context.text.wrap(self.label, context.size, area.width):
            target.blit(context.text.line(words, context.size, FAINT), (area.x, y))
            y += context.text.height(context.size)

    def lines(self, context: DrawContext, width: int) -> int:
        return len(context.text.wrap(self.label, context.size, width))


class Button(Row):
    """Row that ends the form with a `value`."""

    def __init__(self, label: str, value: object) -> None:
        super().__init__(label)
        self.answer = value

    def command(self, command: Command) -> bool:
        return command in (Command.USE, Command.ENTER)


class Choice(Row):
    """Row that chooses one of several values; `changed` receives the new one.

    With `opens`, using the row ends the form with that result, e.g. to open a list.
    """

    def __init__(
        self,
        label: str,
        options: Sequence[tuple[str, object]],
        value: object = None,
        changed: Callable[[object], None] | None = None,
        opens: object = None,
    ) -> None:
        super().__init__(label)
        self.options = tuple(options)
        self.index = 0
        self.answer = opens
        self._changed = changed
        self._middle = 0.75
        self.choose(value)

    @property
    def value(self) -> object:
        return self.options[self.index][1]

    def choose(self, value: object) -> None:
        """Set the value without calling `changed`; use the first option if the value is unknown."""
        values = [option for _, option in self.options]
        self.index = values.index(value) if value in values else 0

    def draw(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        super().draw(target, area, context)
        words = self._right(target, area, context, f"‹ {self.options[self.index][0]} ›")
        self._middle = (words.centerx - area.x) / max(1, area.width)

    def command(self, command: Command) -> bool:
        if self.answer is not None and command in (Command.USE, Command.ENTER):
            return True
        if command in (Command.LEFT, Command.RIGHT, Command.USE):
            step = -1 if command is Command.LEFT else 1
            self.index = (self.index + step) % len(self.options)
            if self._changed is not None:
                self._changed(self.value)
        return False

    def click(self, share: float) -> bool:
        if self.answer is not None:
            return True
        # The value stands between two arrows: a click left of its middle goes back.
        back = min(0.5, 2 * self._middle - 1) < share < self._middle
        return self.command(Command.LEFT if back else Command.RIGHT)


class Slider(Row):
    """Row that chooses a number in a range; `words` formats it."""

    def __init__(
        self,
        label: str,
        value: float,
        low: float,
        high: float,
        step: float,
        words: Callable[[float], str] = "{:g}".format,
        changed: Callable[[float], None] | None = None,
    ) -> None:
        super().__init__(label)
        self.low, self.high, self.step = low, high, step
        self.value = min(high, max(low, value))
        self._words = words
        self._changed = changed
        self._end = _TRACK[1]

    def draw(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        super().draw(target, area, context)
        words = self._right(target, area, context, self._words(self.value))
        self._end = min(_TRACK[1], (words.left - context.size - area.x) / max(1, area.width))
        track = self._track(area, context.size)
        share = (self.value - self.low) / (self.high - self.low)
        target.blit(box(track.size, TRACK, track.height // 2), track)
        knob = pygame.Rect(0, 0, context.size, context.size)
        knob.center = (track.x + round(track.width * share), track.centery)
        target.blit(box(knob.size, PAPER, context.size // 2, INK), knob)

    def command(self, command: Command) -> bool:
        if command in (Command.LEFT, Command.RIGHT):
            self._set(self.value + (self.step if command is Command.RIGHT else -self.step))
        return False

    def click(self, share: float) -> bool:
        along = (share - _TRACK[0]) / max(0.01, self._end - _TRACK[0])
        if -_BESIDE <= along <= 1 + _BESIDE:
            # Rounding to whole steps lets the mouse reach the same values as the keys.
            steps = round(min(1.0, max(0.0, along)) * (self.high - self.low) / self.step)
            self._set(self.low + steps * self.step)
        return False

    def _set(self, value: float) -> None:
        # Without rounding, repeated steps of 0.1 add up to values such as 1.0999999.
        self.value = min(self.high, max(self.low, round(value, 3)))
        if self._changed is not None:
            self._changed(self.value)

    def _track(self, area: pygame.Rect, size: int) -> pygame.Rect:
        left, right = (area.x + area.width * share for share in (_TRACK[0], self._end))
        track = pygame.Rect(round(left), 0, max(1, round(right - left)), max(4, size // 3))
        track.centery = area.centery
        return track


class KeyField(Row):
    """Row that shows a key. Using it waits for another key, which `changed` receives."""

    def __init__(self, label: str, key: str, changed: Callable[[str], None]) -> None:
        super().__init__(label)
        self.current = key
        self.wants_keys = False
        self._changed = changed

    def draw(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        super().draw(target, area, context)
        words = "press a key" if self.wants_keys else key_words(self.current) or "none"
        self._right(target, area, context, words)

    def command(self, command: Command) -> bool:
        if command in (Command.USE, Command.ENTER):
            self.wants_keys = True
        return False

    def key(self, name: str, *, ctrl: bool = False) -> bool:
        if not self.wants_keys:
            return False
        self.wants_keys = False
        # Escape leaves every form, so it cannot be assigned.
        if name != "escape":
            self._changed(name)
        return True


_CARET = "|"


class TextField(Row):
    """Line of text of limited `length`; `changed` receives each new text.

    With `replaced`, receiving the focus selects everything, so that typing replaces it. A second
    click edits the text instead.

    Arrows, Home and End move the caret. Ctrl+A selects all, Ctrl+C copies, Ctrl+X cuts and
    Ctrl+V pastes.
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

    def draw(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        super().draw(target, area, context)
        room = max(
            context.size * 4, area.width - context.text.width(self.label, context.size) * 3 // 2
        )
        if context.focused and self.selected and self.text:
            plate = pygame.Rect(0, 0, 0, round(context.size * 1.6))
            plate.width = min(room, context.text.width(self.text, context.size)) + context.size
            plate.midright = (area.right - context.size // 2, area.centery)
            target.blit(box(plate.size, mixed(PAPER, INK, 0.1), context.size // 3), plate)
        self._right(target, area, context, self._shown(context, room))

    def gained_focus(self) -> None:
        self.selected = self._replaced and bool(self.text)

    def letters(self, text: str) -> None:
        # The clipboard may contain line breaks and control characters.
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

    def _shown(self, context: DrawContext, room: int) -> str:
        """Return the part of the text around the caret that fits."""
        if not context.focused:
            return self.text or self._hint
        if self.selected:
            return self.text
        start = 0
        before, after = self.text[: self._caret], self.text[self._caret :]
        while (
            context.text.width(f"…{before[start:]}{_CARET}", context.size) > room and before[start:]
        ):
            start += 1
        return f"{'…' if start else ''}{before[start:]}{_CARET}{after}"


def _clipboard() -> str:
    """Return the text on the clipboard; empty if there is none."""
    try:
        # Not every video driver has a clipboard.
        return str(pygame.scrap.get_text()).strip()
    except pygame.error:
        return ""


def _copy(text: str) -> None:
    try:
        pygame.scrap.put_text(text)
    except pygame.error:
        return
