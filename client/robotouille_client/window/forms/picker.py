"""List with pictures, groups and a search."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

import pygame

from robotouille_client.window.forms.form import Form, FormLayout, Picture
from robotouille_client.window.forms.widgets import DrawContext, Row, Words
from robotouille_client.window.input.commands import Command, KeyMap
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, CARD, FAINT, INK, TEXT, TRACK, mixed

WIDTH, BESIDE = 64, 24
"""Width of the whole form and of the details, in text heights."""
_HIGH, _PICTURE = 3.4, 3.6
"""Height of an entry and width of its picture, in text heights."""
MAX_TYPED = 40


class EntryText(NamedTuple):
    """Title of an entry, and the line below it."""

    title: str
    detail: str = ""


class PickerEntry(Row):
    """Entry that can be picked; its `answer` is the result.

    Args:
        text: Function that returns the text whenever the entry is drawn.
        about: Function that returns details, shown next to the list for the focused entry.
        also: Further words that a search finds.
    """

    def __init__(
        self,
        answer: object,
        text: Callable[[], EntryText],
        *,
        group: str = "",
        also: str = "",
        picture: Picture | None = None,
        about: Callable[[], str] = lambda: "",
    ) -> None:
        super().__init__(text().title)
        self.answer = answer
        self.text = text
        self.group = group
        self._also = also
        self.picture = picture
        self.about = about

    def height(self, context: DrawContext, width: int) -> int:
        return round(context.size * _HIGH)

    def command(self, command: Command) -> bool:
        return command in (Command.USE, Command.ENTER)

    def matches(self, typed: str) -> bool:
        """Return whether the entry contains all typed words."""
        text = f"{' '.join(self.text())} {self.group} {self._also} {self.about()}".casefold()
        return all(_contains(text, word) for word in typed.casefold().split())

    def distance(self, typed: str) -> int:
        """Return how far the title, without numbers, is from the typed text.

        It is 0 if they are equal, 1 if the title contains the words in sequence, and else 2.
        """
        title = [word for word in self.text().title.casefold().split() if not word.isdigit()]
        words = typed.casefold().split()
        if title == words:
            return 0
        return 1 if " ".join(words) in " ".join(title) else 2

    def draw(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        self._plate(target, area, context)
        x = area.x + context.size // 2
        if self.picture is not None:
            frame = pygame.Rect(
                x, 0, round(context.size * _PICTURE), area.height - context.size // 2
            )
            frame.centery = area.centery
            _framed(target, frame, self.picture(frame.size))
            x = frame.right + context.size // 2
        text, width = self.text(), area.right - context.size // 2 - x
        title = context.text.fit(text.title, context.size, width)
        detail = context.text.fit(text.detail, context.size - 1, width)
        high = context.text.height(context.size)
        y = area.centery - (high if detail else high // 2)
        target.blit(
            context.text.line(title, context.size, INK if context.focused else TEXT), (x, y)
        )
        if detail:
            colour = mixed(INK, ACCENT, 0.15) if context.focused else FAINT
            target.blit(context.text.line(detail, context.size - 1, colour), (x, y + high))


class Picker(Form):
    """Entries in groups, filtered by what the player types.

    Args:
        entries: Entries, with those of a group next to each other.
        ends: Rows below the entries, always visible.
        chosen: Answer of the entry that has the focus at first.
        empty: Text shown if there are no entries.
    """

    def __init__(
        self,
        title: str,
        entries: Sequence[PickerEntry],
        ends: Sequence[Row],
        *,
        chosen: object = None,
        empty: str = "Nothing here yet.",
        idle: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__(title, [], layout=FormLayout(pinned=len(ends)), idle=idle)
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
        """Run a command. Left and right move from group to group."""
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
        # Letters arrive as text as well. Handling the key would choose an entry while typing.
        if len(name) == 1 or name == "space":
            return None
        return super()._key(name, keys, ctrl=ctrl)

    def _type(self, typed: str) -> None:
        """Show the entries that match the typed text."""
        if typed != self.typed:
            self.typed = typed
            self._arrange()
            # Enter then picks the best match.
            if typed:
                self._focus_first()

    def _arrange(self) -> None:
        """Set the rows: the matching entries, each group below its name."""
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
            rows.append(Words("No matches." if self.entries else self._empty))
        self.set_rows([*rows, *self._ends])

    def _nearest_first(self, found: list[PickerEntry]) -> list[PickerEntry]:
        """Order groups and entries by their distance from the typed text."""
        far = {entry: entry.distance(self.typed) for entry in found}
        groups: dict[str, int] = {}
        for entry in found:
            groups[entry.group] = min(far[entry], groups.get(entry.group, far[entry]))
        order = sorted(groups, key=lambda group: groups[group])
        return sorted(found, key=lambda entry: (order.index(entry.group), far[entry]))

    def _leap(self, step: int) -> None:
        """Move the focus to the first entry of another group."""
        firsts: dict[str, Row] = {}
        for row in self.rows:
            if isinstance(row, PickerEntry):
                firsts.setdefault(row.group, row)
        groups, here = list(firsts), self.focused
        if not groups:
            return
        # From a row below the entries, Right leads to the first group and Left to the last one.
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
        for words in (row.text().title, *row.about().split("\n")):
            for line in text.wrap(words, size, width):
                if y + text.height(size) <= area.bottom:
                    target.blit(text.line(line, size, TEXT), (x, y))
                y += text.height(size)
            y += size // 3
        return width


def _contains(text: str, word: str) -> bool:
    """Return whether a text contains a word, or a number: 7 and 07 are in "07", not in "207"."""
    if not word.isdecimal():
        return word in text
    return re.search(rf"(?<!\d)0*{word}", text) is not None


def _framed(target: pygame.Surface, frame: pygame.Rect, picture: pygame.Surface | None) -> None:
    target.blit(box(frame.size, mixed(CARD, TRACK, 0.5), 4), frame)
    if picture is not None:
        target.blit(picture, picture.get_rect(center=frame.center))
