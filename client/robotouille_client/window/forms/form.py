"""A title, rows to go through, and a result: by mouse, keys and gamepad alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pygame

from robotouille_client.window.forms.row_list import RowList
from robotouille_client.window.forms.widgets import Button, Look, Row
from robotouille_client.window.hands.commands import Command, KeyMap
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, PANEL, TEXT, Colour, mixed

__all__ = ["Form", "Picture"]

Picture = Callable[[tuple[int, int]], pygame.Surface | None]
"""A picture that fits into a size in pixels, if there is one (yet)."""

WIDTH, PICTURE = 40, 20
"""Of a form, and of the picture beside its rows, in letters' heights."""
MAX_TOLD = 6
"""Lines of a message."""
MIN_SIZE = 9
"""Letters' height, below which they are hard to read."""


class Form:
    """Rows under a title; `result` is None until one of them, or `cancel`, has given one. The row
    with the focus is marked while the form `listens`.

    Args:
        title: What the form is about.
        rows: From the top; the first that can have it gets the focus.
        cancel: The result of Escape; None where there is no way back.
        picture: What is shown beside the rows where there is room.
        accent: The title's colour.
        pinned: How many of the last rows are always in sight, however many there are.
        idle: Does a bit of what may be late, e.g. loads a picture; whether anything looks different
            now. It is called while its owner does nothing.
        shrinks: Whether letters become smaller before anything has to be scrolled to.
        main: The button that Enter in a field leads to; the next row if None.
    """

    def __init__(
        self,
        title: str,
        rows: Sequence[Row],
        *,
        cancel: object = "back",
        picture: Picture | None = None,
        accent: Colour = ACCENT,
        pinned: int = 0,
        idle: Callable[[], bool] = lambda: False,
        shrinks: bool = False,
        main: Row | None = None,
    ) -> None:
        self.title = title
        self.rows = tuple(rows)
        self.cancel = cancel
        self.picture = picture
        self.message = ""
        self.result: object = None
        self.listens = True
        self.idle = idle
        self._shrinks = shrinks
        self._main = main
        self._accent = accent
        self._list = RowList(pinned)
        self._focus = -1
        self._field: Row | None = None
        self._focus_first()

    @property
    def focused(self) -> Row | None:
        """The row that commands go to."""
        return self.rows[self._focus] if self._focus >= 0 else None

    def focus(self, row: Row) -> None:
        """Move the focus."""
        self._give_focus(self.rows.index(row))

    def set_rows(self, rows: Sequence[Row]) -> None:
        """Show other rows; the focus stays where it is if that is among them."""
        row = self.focused
        self.rows = tuple(rows)
        if row in self.rows:
            self._focus = self.rows.index(row)
        else:
            self._focus_first()

    def place_of(self, row: Row) -> pygame.Rect | None:
        """Where a row was drawn last, as far as it is in sight; None where it is not."""
        places = self._list.places
        return next((place for place, index in places if self.rows[index] is row), None)

    @property
    def scroll_bar(self) -> pygame.Rect:
        """Where the mark of how far it is scrolled was drawn last; empty where all rows have
        room."""
        return self._list.bar

    def width(self, size: int) -> int:
        """How wide it would like to be, with letters of a size."""
        return (WIDTH + (PICTURE if self.picture else 0)) * size

    # Events

    def handle(self, event: pygame.Event, keys: KeyMap) -> Command | None:
        """Follow an event; a command that is not for the form comes back."""
        if event.type == pygame.MOUSEMOTION:
            self._point(event.pos, held=any(event.buttons))
        elif event.type == pygame.MOUSEBUTTONDOWN and event.button == 1:
            self._click(event.pos)
        elif event.type == pygame.MOUSEWHEEL:
            self._go(-event.y)
        elif event.type == pygame.TEXTINPUT:
            self._letters(event.text)
        elif event.type == pygame.KEYDOWN:
            ctrl = bool(getattr(event, "mod", 0) & (pygame.KMOD_CTRL | pygame.KMOD_META))
            return self._key(pygame.key.name(event.key).casefold(), keys, ctrl=ctrl)
        return None

    def command(self, command: Command) -> Command | None:
        """Follow a command; one that is not for the form comes back."""
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
        """They are for the field with the focus, or for the last one if a button has it."""
        field = self._field_for_letters()
        if field is not None:
            self._focus = self.rows.index(field)
            field.letters(text)

    def _field_for_letters(self) -> Row | None:
        row = self.focused
        if row is None or row.wants_letters:
            return row
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
        if row is not None and row.wants_letters and name == "space":
            return None
        if len(name) == 1 and self._field_for_letters() is not None:
            return None
        return self.command(command) if command is not None else None

    def _use(self, row: Row | None, command: Command) -> None:
        if row is not None and row.command(command):
            self._choose(row)

    def _choose(self, row: Row) -> None:
        """What a row asks for: its answer, or, of a field that is filled in, the main button."""
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
        """Give the focus to a row on purpose, not because the mouse goes over it."""
        self._focus = index
        row = self.focused
        if row is not None:
            row.gained_focus()
            self._field = row if row.wants_letters else self._field

    def _move(self, step: int) -> None:
        """Give the focus to the next row that can have it, round and round."""
        for further in range(1, len(self.rows) + 1):
            index = (self._focus + step * further) % len(self.rows)
            if self.rows[index].focusable:
                self._give_focus(index)
                return

    def _go(self, steps: int) -> None:
        """Move the focus by so many rows, and not beyond the ends."""
        able = [index for index, row in enumerate(self.rows) if row.focusable]
        if self._focus in able:
            at = able.index(self._focus) + steps
            self._give_focus(able[min(len(able) - 1, max(0, at))])

    def _point(self, pos: tuple[int, int], *, held: bool) -> None:
        if held and self._list.bar.collidepoint(pos):
            self._scroll_to(pos[1])
            return
        found = self._list.row_at(pos, whole=True)
        if found is not None and self.rows[found[1]].focusable:
            self._focus = found[1]

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
        """Bring the part of the rows into sight that the mark of a place stands for."""
        able = [index for index, row in enumerate(self.rows) if row.focusable]
        share = (y - self._list.bar.y) / max(1, self._list.bar.height)
        if able:
            self._focus = able[min(len(able) - 1, max(0, int(share * len(able))))]

    # Drawing

    def draw(self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int) -> None:
        """Fill an area of the window; what does not fit is scrolled to."""
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
        self._list.draw(target, place, self.rows, self._focus, text, size, marked=self.listens)
        for i, line in enumerate(foot):
            at = (inner.x, bottom + i * text.height(size))
            target.blit(text.line(line, size, ACCENT), at)

    def _fitting(self, area: pygame.Rect, text: Typesetter, size: int) -> int:
        """The size of letters, as large as can be, with which there is room for all."""
        least = max(MIN_SIZE, size * 3 // 5)
        sizes = range(size, least, -1)
        fits = (s for s in sizes if self._needed(area.width - 2 * s, text, s) <= area.height)
        return next(fits, min(size, least))

    def _needed(self, width: int, text: Typesetter, size: int) -> int:
        """The height of all there is in a width."""
        large, look = round(size * 1.5), Look(text, size, focused=False)
        title = len(text.wrap(self.title, large, width, 3)) * text.height(large)
        foot = len(text.wrap(self.message, size, width, MAX_TOLD)) * text.height(size)
        rows = sum(row.height(look, width) + max(3, size // 4) for row in self.rows)
        return title + rows + foot + 3 * size

    def _draw_title(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int
    ) -> pygame.Rect:
        """Draw the title; what is left of the area."""
        y, large = area.y, round(size * 1.5)
        for line in text.wrap(self.title, large, area.width, 3):
            target.blit(text.line(line, large, self._accent), (area.x, y))
            y += text.height(large)
        y += size // 2
        return pygame.Rect(area.x, y, area.width, area.bottom - y)

    def _draw_beside(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int
    ) -> int:
        """Draw what is on the right of the rows; how wide that is."""
        if self.picture is None or area.width < 2 * PICTURE * size:
            return 0
        picture = self.picture((PICTURE * size, area.height))
        if picture is not None:
            target.blit(picture, picture.get_rect(topright=area.topright))
        return PICTURE * size
