"""Rows of a form: buttons, choices, sliders, fields for keys.

A row draws itself into an area and is changed by commands, letters and clicks; it knows nothing of
the other rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import pygame

from robotouille_client.window.hands.commands import Command, key_words
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, CARD, FAINT, INK, PAPER, TEXT, TRACK

__all__ = ["Button", "Choice", "KeyField", "Look", "Row", "Slider", "Words"]

_DOUBLE = 5 / 2
"""How high a row is that one can go to, in letters' heights."""
_TRACK, _BESIDE = (0.4, 0.75), 0.08
"""Where the track of a slider is at most, as shares of the row; how far beside it a click is still
meant for it, as a share of the track."""


@dataclass(frozen=True, slots=True)
class Look:
    """How a row is drawn: letters of a `size`, and whether it has the focus."""

    text: Typesetter
    size: int
    focused: bool


class Row:
    """One line of a form; `label` says what it is.

    `answer` is the form's result when the row is asked for what it stands for; None where it stands
    for nothing but itself.
    """

    focusable = True
    wants_letters = False
    wants_keys = False
    answer: object = None

    def __init__(self, label: str) -> None:
        self.label = label

    def draw(self, target: pygame.Surface, area: pygame.Rect, look: Look) -> None:
        """Draw into an area."""
        self._plate(target, area, look)
        self._label(target, area, look)

    def lines(self, look: Look, width: int) -> int:
        """How many lines it needs in a width."""
        return 1

    def height(self, look: Look, width: int) -> int:
        """How many pixels it needs in a width."""
        if self.focusable:
            return round(look.size * _DOUBLE)
        return self.lines(look, width) * look.text.height(look.size) + look.size // 2

    def command(self, command: Command) -> bool:
        """Whether a command changed the row, or asks for what it stands for."""
        return False

    def gained_focus(self) -> None:
        """Commands and letters are for the row from now on."""

    def letters(self, text: str) -> None:
        """Letters were typed while the row had the focus."""

    def key(self, name: str, *, ctrl: bool = False) -> bool:
        """Whether a key, pressed with Ctrl or without, was for the row, before it means a
        command."""
        return False

    def click(self, share: float) -> bool:
        """A click at a share of the width; whether it asks for what the row stands for."""
        return self.command(Command.USE)

    def _plate(self, target: pygame.Surface, area: pygame.Rect, look: Look) -> None:
        fill = ACCENT if look.focused else CARD
        target.blit(box(area.size, fill, look.size // 2), area)

    def _label(self, target: pygame.Surface, area: pygame.Rect, look: Look) -> None:
        words = look.text.fit(self.label, look.size, area.width - 2 * look.size)
        line = look.text.line(words, look.size, INK if look.focused else TEXT)
        target.blit(line, line.get_rect(midleft=(area.x + look.size, area.centery)))

    def _right(
        self, target: pygame.Surface, area: pygame.Rect, look: Look, words: str
    ) -> pygame.Rect:
        """Words at the right end, in what the label leaves; where they are."""
        used = look.text.width(self.label, look.size)
        room = max(look.size * 4, area.width - used - 4 * look.size)
        fitting = look.text.fit(words, look.size, room)
        line = look.text.line(fitting, look.size, INK if look.focused else FAINT)
        place = line.get_rect(midright=(area.right - look.size, area.centery))
        target.blit(line, place)
        return place


class Words(Row):
    """Words that nobody can change."""

    focusable = False

    def draw(self, target: pygame.Surface, area: pygame.Rect, look: Look) -> None:
        y = area.y + look.size // 3
        for words in look.text.wrap(self.label, look.size, area.width):
            target.blit(look.text.line(words, look.size, FAINT), (area.x, y))
            y += look.text.height(look.size)

    def lines(self, look: Look, width: int) -> int:
        return len(look.text.wrap(self.label, look.size, width))


class Button(Row):
    """Ends the form with a `value`."""

    def __init__(self, label: str, value: object) -> None:
        super().__init__(label)
        self.answer = value

    def command(self, command: Command) -> bool:
        return command in (Command.USE, Command.ENTER)


class Choice(Row):
    """One of several values, each with words for it; `changed` is told the new one.

    With an `opens`, using it ends the form with that, so that one can choose from a list.
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
        """The value that is chosen."""
        return self.options[self.index][1]

    def choose(self, value: object) -> None:
        """Set it to a value, which nobody is told; the first one where it has no such."""
        values = [option for _, option in self.options]
        self.index = values.index(value) if value in values else 0

    def draw(self, target: pygame.Surface, area: pygame.Rect, look: Look) -> None:
        super().draw(target, area, look)
        words = self._right(target, area, look, f"‹ {self.options[self.index][0]} ›")
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
        back = min(0.5, 2 * self._middle - 1) < share < self._middle
        return self.command(Command.LEFT if back else Command.RIGHT)


class Slider(Row):
    """A number between two others, in steps; `words` says it."""

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

    def draw(self, target: pygame.Surface, area: pygame.Rect, look: Look) -> None:
        super().draw(target, area, look)
        words = self._right(target, area, look, self._words(self.value))
        self._end = min(_TRACK[1], (words.left - look.size - area.x) / max(1, area.width))
        track = self._track(area, look.size)
        share = (self.value - self.low) / (self.high - self.low)
        target.blit(box(track.size, TRACK, track.height // 2), track)
        knob = pygame.Rect(0, 0, look.size, look.size)
        knob.center = (track.x + round(track.width * share), track.centery)
        target.blit(box(knob.size, PAPER, look.size // 2, INK), knob)

    def command(self, command: Command) -> bool:
        if command in (Command.LEFT, Command.RIGHT):
            self._set(self.value + (self.step if command is Command.RIGHT else -self.step))
        return False

    def click(self, share: float) -> bool:
        along = (share - _TRACK[0]) / max(0.01, self._end - _TRACK[0])
        if -_BESIDE <= along <= 1 + _BESIDE:
            steps = round(min(1.0, max(0.0, along)) * (self.high - self.low) / self.step)
            self._set(self.low + steps * self.step)
        return False

    def _set(self, value: float) -> None:
        self.value = min(self.high, max(self.low, round(value, 3)))
        if self._changed is not None:
            self._changed(self.value)

    def _track(self, area: pygame.Rect, size: int) -> pygame.Rect:
        left, right = (area.x + area.width * share for share in (_TRACK[0], self._end))
        track = pygame.Rect(round(left), 0, max(1, round(right - left)), max(4, size // 3))
        track.centery = area.centery
        return track


class KeyField(Row):
    """A key, which is asked for anew when the row is used; `changed` is told it."""

    def __init__(self, label: str, key: str, changed: Callable[[str], None]) -> None:
        super().__init__(label)
        self.current = key
        self.wants_keys = False
        self._changed = changed

    def draw(self, target: pygame.Surface, area: pygame.Rect, look: Look) -> None:
        super().draw(target, area, look)
        words = "press a key" if self.wants_keys else key_words(self.current) or "none"
        self._right(target, area, look, words)

    def command(self, command: Command) -> bool:
        if command in (Command.USE, Command.ENTER):
            self.wants_keys = True
        return False

    def key(self, name: str, *, ctrl: bool = False) -> bool:
        if not self.wants_keys:
            return False
        self.wants_keys = False
        if name != "escape":
            self._changed(name)
        return True
