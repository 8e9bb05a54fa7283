"""A list to pick one from: with pictures, in groups, narrowed down by typing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import pygame

from robotouille_client.window.forms.form import Form, Picture
from robotouille_client.window.forms.widgets import Look, Row, Words
from robotouille_client.window.hands.commands import Command, KeyMap
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, CARD, FAINT, INK, TEXT, TRACK, mixed

__all__ = ["Picker", "PickerEntry", "Told"]

WIDTH, BESIDE = 64, 24
"""Of all of it, and of what is told of the one with the focus, in letters' heights."""
_HIGH, _PICTURE = 3.4, 3.6
"""Of an entry, and how wide its picture is."""
MAX_TYPED = 40


class Told(NamedTuple):
    """What an entry says: a title, and a line below it."""

    title: str
    detail: str = ""


class PickerEntry(Row):
    """Something to pick: `answer`.

    Args:
        told: Says it; asked for whenever the entry is drawn.
        picture: What it looks like, if anything.
        about: What else is told where there is room: of the entry with the focus.
    """

    def __init__(
        self,
        answer: object,
        told: Callable[[], Told],
        *,
        group: str = "",
        picture: Picture | None = None,
        about: Callable[[], str] = lambda: "",
    ) -> None:
        super().__init__(told().title)
        self.answer = answer
        self.told = told
        self.group = group
        self.picture = picture
        self.about = about

    def height(self, look: Look, width: int) -> int:
        return round(look.size * _HIGH)

    def command(self, command: Command) -> bool:
        return command in (Command.USE, Command.ENTER)

    def matches(self, typed: str) -> bool:
        """Whether all words that were typed are in what it says."""
        said = f"{' '.join(self.told())} {self.group} {self.about()}".casefold()
        return all(word in said for word in typed.casefold().split())

    def distance(self, typed: str) -> int:
        """How far its title, but for a number, is from what was typed: 0 where it is that, 1 where
        it has those words as they follow each other, else 2."""
        title = [word for word in self.told().title.casefold().split() if not word.isdigit()]
        words = typed.casefold().split()
        if title == words:
            return 0
        return 1 if " ".join(words) in " ".join(title) else 2

    def draw(self, target: pygame.Surface, area: pygame.Rect, look: Look) -> None:
        self._plate(target, area, look)
        x = area.x + look.size // 2
        if self.picture is not None:
            frame = pygame.Rect(x, 0, round(look.size * _PICTURE), area.height - look.size // 2)
            frame.centery = area.centery
            _framed(target, frame, self.picture(frame.size))
            x = frame.right + look.size // 2
        said, width = self.told(), area.right - look.size // 2 - x
        title = look.text.fit(said.title, look.size, width)
        detail = look.text.fit(said.detail, look.size - 1, width)
        high = look.text.height(look.size)
        y = area.centery - (high if detail else high // 2)
        target.blit(look.text.line(title, look.size, INK if look.focused else TEXT), (x, y))
        if detail:
            colour = mixed(INK, ACCENT, 0.15) if look.focused else FAINT
            target.blit(look.text.line(detail, look.size - 1, colour), (x, y + high))


class Picker(Form):
    """Entries in groups, with what is typed as a filter; the result is the answer of one.

    Args:
        entries: From the top; those of a group follow each other.
        ends: What stands below them, always in sight.
        chosen: The answer of the entry that has the focus at first.
        empty: What is told where there are none.
    """

    def __init__(
        self,
        title: str,
        entries: Sequence[PickerEntry],
        ends: Sequence[Row],
        *,
        chosen: object = None,
        empty: str = "There is nothing here.",
        idle: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__(title, [], pinned=len(ends), idle=idle)
        self.entries = tuple(entries)
        self.typed = ""
        self._ends = tuple(ends)
        self._empty = empty
        self._arrange()
        found = next((entry for entry in self.entries if entry.answer == chosen), None)
        if found is not None:
            self.focus(found)

    def width(self, size: int) -> int:
        return WIDTH * size

    def command(self, command: Command) -> Command | None:
        """Sides lead from group to group."""
        if command in (Command.LEFT, Command.RIGHT):
            self._leap(-1 if command is Command.LEFT else 1)
            return None
        if command is Command.CANCEL and self.typed:
            self._type("")
            return None
        return super().command(command)

    def _letters(self, text: str) -> None:
        typed = "".join(letter for letter in text if letter.isprintable())
        self._type((self.typed + typed).lstrip()[:MAX_TYPED])

    def _key(self, name: str, keys: KeyMap, *, ctrl: bool) -> Command | None:
        if name == "backspace":
            self._type("" if ctrl else self.typed[:-1])
            return None
        if len(name) == 1 or name == "space":
            return None
        return super()._key(name, keys, ctrl=ctrl)

    def _type(self, typed: str) -> None:
        """Show what has the words that were typed."""
        if typed != self.typed:
            self.typed = typed
            self._arrange()
            if typed:
                self._focus_first()

    def _arrange(self) -> None:
        """The entries that are shown, the nearest first, each group below its name."""
        rows: list[Row] = []
        group = ""
        found = [entry for entry in self.entries if entry.matches(self.typed)]
        if self.typed.strip():
            found = self._nearest_first(found)
        for entry in found:
            if entry.group and entry.group != group:
                rows.append(Words(entry.group))
            group = entry.group
            rows.append(entry)
        if not rows:
            rows.append(Words("Nothing has these words." if self.entries else self._empty))
        self.set_rows([*rows, *self._ends])

    def _nearest_first(self, found: list[PickerEntry]) -> list[PickerEntry]:
        """The group with the entry that is nearest to what was typed first, and in it that one."""
        far = {entry: entry.distance(self.typed) for entry in found}
        groups: dict[str, int] = {}
        for entry in found:
            groups[entry.group] = min(far[entry], groups.get(entry.group, far[entry]))
        order = sorted(groups, key=lambda group: groups[group])
        return sorted(found, key=lambda entry: (order.index(entry.group), far[entry]))

    def _leap(self, step: int) -> None:
        """Move the focus to the first entry of the group before, or after, its own."""
        firsts: dict[str, Row] = {}
        for row in self.rows:
            if isinstance(row, PickerEntry):
                firsts.setdefault(row.group, row)
        groups, here = list(firsts), self.focused
        if not groups:
            return
        at = groups.index(here.group) + step if isinstance(here, PickerEntry) else min(0, step)
        self.focus(firsts[groups[at % len(groups)]])

    # Drawing

    def _draw_title(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int
    ) -> pygame.Rect:
        left = super()._draw_title(target, area, text, size)
        found = sum(isinstance(row, PickerEntry) for row in self.rows)
        words = f"Search: {self.typed}|   {found} found" if self.typed else "Type to search"
        line = text.line(text.fit(words, size, left.width), size, TEXT if self.typed else FAINT)
        target.blit(line, left.topleft)
        down = text.height(size) + size // 2
        return pygame.Rect(left.x, left.y + down, left.width, left.height - down)

    def _draw_beside(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int
    ) -> int:
        row, width = self.focused, BESIDE * size
        if area.width < 2 * width:
            return 0
        if not isinstance(row, PickerEntry):
            return width
        x, y = area.right - width, area.y
        if row.picture is not None:
            frame = pygame.Rect(x, y, width, min(width * 7 // 8, area.height * 3 // 5))
            _framed(target, frame, row.picture(frame.size))
            y = frame.bottom + size // 2
        for words in (row.told().title, *row.about().split("\n")):
            for line in text.wrap(words, size, width):
                if y + text.height(size) <= area.bottom:
                    target.blit(text.line(line, size, TEXT), (x, y))
                y += text.height(size)
            y += size // 3
        return width


def _framed(target: pygame.Surface, frame: pygame.Rect, picture: pygame.Surface | None) -> None:
    """A picture in the middle of a frame, which is there before it."""
    target.blit(box(frame.size, mixed(CARD, TRACK, 0.5), 4), frame)
    if picture is not None:
        target.blit(picture, picture.get_rect(center=frame.center))
