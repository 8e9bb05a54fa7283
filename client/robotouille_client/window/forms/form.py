"""Forms: a title, rows to choose from, and a result."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import pygame

from robotouille_client.window.forms.rows import RowList
from robotouille_client.window.forms.widgets import Button, DrawContext, Row
from robotouille_client.window.input.commands import Command, KeyMap
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, PANEL, TEXT, Colour, mixed

Picture = Callable[[tuple[int, int]], pygame.Surface | None]
"""Function that returns a picture for a size in pixels; None if there is none yet."""

WIDTH, PICTURE = 40, 20
"""Width of a form and of its picture, in text heights."""
MAX_TOLD = 6
"""Maximum number of lines of a message."""
MIN_SIZE = 9
"""Smallest readable text height."""


@dataclass(frozen=True, slots=True)
class FormLayout:
    """Drawing options of a form.

    Attributes:
        picture: Picture next to the rows, if there is room.
        accent: Colour of the title.
        pinned: Number of rows at the end that are always visible.
        shrinks: True to reduce the text size before scrolling.
    """

    picture: Picture | None = None
    accent: Colour = ACCENT
    pinned: int = 0
    shrinks: bool = False


class Form:
    """Title with rows, one of which has the focus.

    `result` is None until the player chooses a row or cancels. The focus is marked while the form
    `listens`. `age` is the time in seconds for which it has been shown, if something in it moves.

    Args:
        cancel: Result of Escape; None if the form cannot be cancelled.
        idle: Function called while the player does nothing, e.g. to load a picture. It returns
            whether the form must be drawn again.
        main: Button to which Enter in a field leads; None for the next row.
    """

    def __init__(
        self,
        title: str,
        rows: Sequence[Row],
        *,
        cancel: object = "back",
        layout: FormLayout = FormLayout(),
        idle: Callable[[], bool] = lambda: False,
        main: Row | None = None,
    ) -> None:
        self.title = title
        self.rows = tuple(rows)
        self.cancel = cancel
        self.picture = layout.picture
        self.message = ""
        self.result: object = None
        self.listens = True
        self.age = math.inf
        self.idle = idle
        self._shrinks = layout.shrinks
        self._main = main
        self._accent = layout.accent
        self._list = RowList(layout.pinned)
        self._focus = -1
        self._field: Row | None = None
        self._focus_first()

    @property
    def focused(self) -> Row | None:
        """The row that receives commands."""
        return self.rows[self._focus] if self._focus >= 0 else None

    def focus(self, row: Row) -> None:
        self._give_focus(self.rows.index(row))

    def set_rows(self, rows: Sequence[Row]) -> None:
        """Replace the rows; the focus stays if its row is still there."""
        row = self.focused
        self.rows = tuple(rows)
        if row in self.rows:
            self._focus = self.rows.index(row)
        else:
            self._focus_first()

    def place_of(self, row: Row) -> pygame.Rect | None:
        """Return where a row was last drawn; None if it was not visible."""
        places = self._list.places
        return next((place for place, index in places if self.rows[index] is row), None)

    @property
    def scroll_bar(self) -> pygame.Rect:
        """Area of the scroll bar when the form was last drawn; empty if all rows fitted."""
        return self._list.bar

    def width(self, size: int) -> int:
        """Return the preferred width for a text size."""
        return (WIDTH + (PICTURE if self.picture else 0)) * size

    # Events

    def handle(self, event: pygame.Event, keys: KeyMap) -> Command | None:
        """Handle an event; return a command that is not for the form."""
        if event.type == pygame.MOUSEMOTION:
            self._point(event.pos, held=any(event.buttons))
        elif event.type == pygame.MOUSEBUTTONDOWN and event.button == 1:
            self._click(event.pos)
        elif event.type == pygame.MOUSEWHEEL:
            self._go(-event.y)
        elif event.type == pygame.TEXTINPUT:
            self._letters(event.text)
        elif event.type == pygame.KEYDOWN:
            # On macOS, Command has the role of Ctrl.
            ctrl = bool(getattr(event, "mod", 0) & (pygame.KMOD_CTRL | pygame.KMOD_META))
            return self._key(pygame.key.name(event.key).casefold(), keys, ctrl=ctrl)
        return None

    def command(self, command: Command) -> Command | None:
        """Run a command; return it if it is not for the form."""
        if command is Command.CANCEL:
            self.result = self.cancel
        elif command in (Command.UP, Command.DOWN, Command.LIST):
            self._move(-1 if command is Command.UP else 1)
        elif command in (Command.LEFT, Command.RIGHT, Command.USE, Command.ENTER):
            self._use(self.focused, command)
        else:
            return command
        return None

    def _letters(self, text: str) -> None:
        """Type letters into the focused field, or into the last field if a button has the focus."""
        field = self._field_for_letters()
        if field is not None:
            self._focus = self.rows.index(field)
            field.letters(text)

    def _field_for_letters(self) -> Row | None:
        row = self.focused
        if row is None or row.wants_letters:
            return row
        # Enter moves the focus from a field to a button, and players often continue to type there.
        is_here = isinstance(row, Button) and self._field in self.rows
        return self._field if is_here else None

    def _key(self, name: str, keys: KeyMap, *, ctrl: bool) -> Command | None:
        row = self.focused
        if row is not None and row.key(name, ctrl=ctrl):
            return None
        pages = {"page up": -self._list.page, "page down": self._list.page}
        if name in (*pages, "home", "end"):
            self._go(pages.get(name, -len(self.rows) if name == "home" else len(self.rows)))
            return None
        command = keys.command(name)
        # A space in a field is text, which arrives in an event of its own.
        if row is not None and row.wants_letters and name == "space":
            return None
        # Letters such as E and W are also commands, but here they are typed.
        if len(name) == 1 and self._field_for_letters() is not None:
            return None
        return self.command(command) if command is not None else None

    def _use(self, row: Row | None, command: Command) -> None:
        if row is not None and row.command(command):
            self._choose(row)

    def _choose(self, row: Row) -> None:
        """Take the row's answer, or move the focus from a filled field to the main button."""
        if row.answer is not None:
            self.result = row.answer
            return
        if self._main in self.rows:
            self.focus(self._main)
            return
        following = self.rows[self.rows.index(row) + 1 :]
        button = next((r for r in following if r.focusable), None)
        if button is not None:
            self.focus(button)

    def _focus_first(self) -> None:
        self._give_focus(next((i for i, row in enumerate(self.rows) if row.focusable), -1))

    def _give_focus(self, index: int) -> None:
        """Move the focus on the player's request, not because the mouse passes over a row."""
        self._focus = index
        row = self.focused
        if row is not None:
            row.gained_focus()
            self._field = row if row.wants_letters else self._field

    def _move(self, step: int) -> None:
        """Move the focus to the next row that can have it, around the ends."""
        for further in range(1, len(self.rows) + 1):
            index = (self._focus + step * further) % len(self.rows)
            if self.rows[index].focusable:
                self._give_focus(index)
                return

    def _go(self, steps: int) -> None:
        """Move the focus by a number of rows, stopping at the ends."""
        able = [index for index, row in enumerate(self.rows) if row.focusable]
        if self._focus in able:
            at = able.index(self._focus) + steps
            self._give_focus(able[min(len(able) - 1, max(0, at))])

    def _point(self, pos: tuple[int, int], *, held: bool) -> None:
        if held and self._list.bar.collidepoint(pos):
            self._scroll_to(pos[1])
            return
        # A row that is cut off would scroll when focused, and so move away from the mouse.
        found = self._list.row_at(pos, whole=True)
        # This does not use `_give_focus`, because a field must not select its text when the mouse
        # passes.
        if found is not None and self.rows[found[1]].focusable:
            area, self._focus = found
            self.rows[self._focus].point((pos[0] - area.x) / area.width)

    def _click(self, pos: tuple[int, int]) -> None:
        if self._list.bar.collidepoint(pos):
            self._scroll_to(pos[1])
            return
        found = self._list.row_at(pos)
        if found is None or not self.rows[found[1]].focusable:
            return
        area, self._focus = found
        row = self.rows[self._focus]
        self._field = row if row.wants_letters else self._field
        if row.click((pos[0] - area.x) / area.width):
            self._choose(row)

    def _scroll_to(self, y: int) -> None:
        """Focus the row that a position on the scroll bar stands for."""
        able = [index for index, row in enumerate(self.rows) if row.focusable]
        share = (y - self._list.bar.y) / max(1, self._list.bar.height)
        if able:
            self._focus = able[min(len(able) - 1, max(0, int(share * len(able))))]

    # Drawing

    def draw(self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int) -> None:
        """Draw the form into an area of the window."""
        size = self._fitting(area, text, size) if self._shrinks else size
        pad = size
        target.blit(box(area.size, PANEL, pad, mixed(PANEL, TEXT, 0.25)), area)
        inner = area.inflate(-2 * pad, -2 * pad)
        inner = self._draw_title(target, inner, text, size)
        beside = self._draw_beside(target, inner, text, size)
        inner.width -= beside + (pad if beside else 0)
        foot = text.wrap(self.message, size, inner.width, MAX_TOLD)
        bottom = inner.bottom - text.height(size) * len(foot)
        room = bottom - inner.y - (size // 2 if foot else 0)
        place = pygame.Rect(inner.x, inner.y, inner.width, room)
        context = DrawContext(text, size, focused=False, age=self.age)
        self._list.draw(target, place, self.rows, self._focus, context, marked=self.listens)
        for i, line in enumerate(foot):
            at = (inner.x, bottom + i * text.height(size))
            target.blit(text.line(line, size, ACCENT), at)

    def _fitting(self, area: pygame.Rect, text: Typesetter, size: int) -> int:
        """Return the largest text size at which everything fits."""
        least = max(MIN_SIZE, size * 3 // 5)
        # The wrapping depends on the text size, so each size has to be measured.
        sizes = range(size, least, -1)
        fits = (s for s in sizes if self._needed(area.width - 2 * s, text, s) <= area.height)
        return next(fits, min(size, least))

    def _needed(self, width: int, text: Typesetter, size: int) -> int:
        """Return the height of the whole form at a width."""
        large, context = round(size * 1.5), DrawContext(text, size, focused=False)
        title = len(text.wrap(self.title, large, width, 3)) * text.height(large)
        foot = len(text.wrap(self.message, size, width, MAX_TOLD)) * text.height(size)
        rows = sum(row.height(context, width) + max(3, size // 4) for row in self.rows)
        return title + rows + foot + 3 * size

    def _draw_title(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int
    ) -> pygame.Rect:
        y, large = area.y, round(size * 1.5)
        for line in text.wrap(self.title, large, area.width, 3):
            target.blit(text.line(line, large, self._accent), (area.x, y))
            y += text.height(large)
        y += size // 2
        return pygame.Rect(area.x, y, area.width, area.bottom - y)

    def _draw_beside(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int
    ) -> int:
        """Draw what is to the right of the rows; return its width."""
        if self.picture is None or area.width < 2 * PICTURE * size:
            return 0
        picture = self.picture((PICTURE * size, area.height))
        if picture is not None:
            target.blit(picture, picture.get_rect(topright=area.topright))
        return PICTURE * size
