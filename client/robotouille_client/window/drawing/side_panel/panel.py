"""Panel next to the kitchen: the goal, the clock, the seats and the chat."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace
from math import ceil

import pygame

from robotouille.world.world import State
from robotouille_client.window.drawing.kitchen.pops import Pop, Pops
from robotouille_client.window.drawing.side_panel.order_slips import OrderSlips
from robotouille_client.window.drawing.side_panel.seat_cards import SeatCards
from robotouille_client.window.drawing.side_panel.ticket import Ticket
from robotouille_client.window.drawing.tags.tips import Listing
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import AppearanceResolver
from robotouille_client.window.pictures.shapes import bar, pill, seat_ink
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    BAD,
    FAINT,
    GOOD,
    INK,
    PANEL,
    TEXT,
    TRACK,
    Colour,
    mixed,
)
from robotouille_client.window.sources.texts import dish_title, task_heading
from robotouille_client.window.view import NEWS, View

# Number of steps whose duration fits any type.
MAX_STEPS = 10**9


def with_readable_names(view: View, text: Typesetter) -> View:
    """Return a view in which participants with unreadable names are called by their player."""
    if all(seat.name.isascii() for seat in view.seats):
        return view
    called = {
        seat.name: seat.player
        for seat in view.seats
        if seat.name and not text.is_readable(seat.name)
    }
    if not called:
        return view
    return replace(
        view,
        seats=tuple(replace(seat, name=called.get(seat.name, seat.name)) for seat in view.seats),
        chat=tuple((called.get(name, name), said) for name, said in view.chat),
    )


class Panel:
    """Draws the panel, again only if something in it has changed.

    `free` is the area that holds nothing but chat, as drawn last.
    """

    def __init__(self, resolver: AppearanceResolver, sprites: Sprites, text: Typesetter) -> None:
        self._resolver = resolver
        self._rendering = resolver.rendering
        self._sprites = sprites
        self._text = text
        self._seats = SeatCards(resolver, sprites, text)
        self._ticket: Ticket | OrderSlips | None = None
        self._ticket_area = pygame.Rect(0, 0, 0, 0)
        self._ticket_drawn: tuple[tuple[object, ...], pygame.Surface] | None = None
        self._surface: pygame.Surface | None = None
        self._shown: tuple[object, ...] = ()
        self._pops = Pops()
        self.free = pygame.Rect(0, 0, 0, 0)
        self._settled: State

    def draw(
        self, target: pygame.Surface, layout: Layout, view: View, settled: State | None = None
    ) -> None:
        """Draw the panel on the right of the window.

        `settled` is the state that the ticket shows, if some objects of the view's state are still
        on their way.
        """
        self._settled = settled or view.state
        if self._ticket is None:
            kind = Ticket if view.world.shift is None else OrderSlips
            self._ticket = kind(view, self._resolver, self._sprites, self._text)
        shown = (
            layout, id(view.world), view.step, view.max_steps, view.clock, view.seats,
            view.me, view.chat, view.status, view.code, view.waits_for, view.blocked, view.watching,
            view.spectator_names, view.thinking, view.step_seconds,
            self._ticket.redraw_key(self._settled),
        )  # fmt: skip
        if self._surface is None or shown != self._shown:
            self._surface = self._render(layout, view)
            self._shown = shown
            self._pops.follow(self._pops_in_window(), view.seconds)
        target.blit(self._surface, layout.panel)
        self._pops.draw(target, view.seconds)

    def _pops_in_window(self) -> dict[Hashable, Pop]:
        """Return what may pop up, with its places in the window."""
        left, top = self._ticket_area.topleft
        found = {} if self._ticket is None else self._ticket.pops
        return {
            key: replace(pop, middle=(pop.middle[0] + left, pop.middle[1] + top))
            for key, pop in found.items()
        }

    def moving(self, seconds: float | None) -> tuple[float, ...]:
        """Return a value that changes as long as something moves in the panel."""
        return self._pops.moving(seconds)

    def _render(self, layout: Layout, view: View) -> pygame.Surface:
        surface = self._surface
        if surface is None or surface.get_size() != layout.panel.size:
            surface = pygame.Surface(layout.panel.size)
        surface.fill(PANEL)
        surface.fill(INK, (0, 0, 2, layout.panel.height))
        pad = layout.text
        area = pygame.Rect(pad, pad, layout.panel.width - 2 * pad, layout.panel.height - 2 * pad)
        y = self._title(surface, area, layout, view)
        y = self._goal(surface, area, y, layout, view)
        y = self._clock(surface, area, y, layout, view)
        room = pygame.Rect(area.x, y, area.width, max(0, area.bottom - y))
        y = self._seats.draw(surface, room, layout, view)
        self.free = pygame.Rect(*layout.panel.topleft, *layout.panel.size)
        self.free.height, self.free.top = max(0, layout.panel.height - y), layout.panel.top + y
        self._chat(surface, area, y, layout, view)
        return surface

    def _put(
        self, surface: pygame.Surface, words: str, at: tuple[int, int], size: int, colour: Colour
    ) -> int:
        """Draw a line. Return the height used."""
        surface.blit(self._text.line(words, size, colour), at)
        return self._text.height(size)

    def _title(self, surface: pygame.Surface, area: pygame.Rect, layout: Layout, view: View) -> int:
        size, y = layout.text, area.y
        task = view.world.task
        title = dish_title(task.name, task.goal_description)
        small = max(10, size - 3)
        above = task_heading(task.name)
        room = area.width
        if view.code:
            code = self._text.fit(f"code {view.code}", small, area.width - size)
            plate = pill(self._text.line(code, small, INK), ACCENT)
            surface.blit(plate, plate.get_rect(topright=(area.right, y - 2)))
            room -= plate.get_width() + size // 2
        above = self._text.fit(above, small, room) if room > 3 * size else ""
        large, most = (size, 1) if layout.compact else (size + 3, 3)
        if view.code or not layout.compact:
            y += self._put(surface, above, (area.x, y), small, FAINT) + 2
        for line in self._text.wrap(title, large, area.width, most):
            y += self._put(surface, line, (area.x, y), large, TEXT)
        if view.waits_for:
            y += self._waiting(surface, pygame.Rect(area.x, y + 2, area.width, 0), small, view)
        elif view.status:
            for line in self._text.wrap(view.status, small, area.width, 2):
                y += self._put(surface, line, (area.x, y + 2), small, ACCENT)
        elif not layout.compact:
            y += self._text.height(small)  # Reserved, so that a status line moves nothing.
        return y + size // 2

    def _waiting(self, surface: pygame.Surface, area: pygame.Rect, size: int, view: View) -> int:
        """Draw whom the step waits for in seat colours, on at most two lines. Return the height."""
        names = {seat.player: seat.name or seat.player for seat in view.seats}
        colours = self._colours(view)
        parts = [("Waiting for", ACCENT)]
        for player in view.waits_for:
            name = "you" if player == view.me else names.get(player, player)
            parts.append((name, colours.get(player, FAINT)))
        x, y, blank = area.x, area.y, self._text.width(" ", size)
        step = self._text.height(size)
        room = area.width - self._text.width(", …", size)
        for i, (name, colour) in enumerate(parts):
            comma = "," if 0 < i < len(parts) - 1 else ""
            words = self._text.fit(name, size, room) + comma
            width = self._text.width(words, size)
            if x + width > area.right:
                if y > area.y:
                    self._put(surface, "…", (x, y), size, FAINT)
                    break
                x, y = area.x, y + step
            self._put(surface, words, (x, y), size, colour)
            x += width + blank
        return y + step - area.y

    def tooltip(self, pointer: tuple[int, int] | None) -> tuple[str, ...]:
        """Return the goal in words if the mouse is on the ticket."""
        if self._ticket is None or pointer is None or not self._ticket_area.collidepoint(pointer):
            return ()
        left, top = self._ticket_area.topleft
        return self._ticket.tooltip((pointer[0] - left, pointer[1] - top))

    def listing(self, pointer: tuple[int, int] | None) -> Listing:
        """Return the layers of the dish whose order is under the mouse."""
        on_it = pointer is not None and self._ticket_area.collidepoint(pointer)
        if pointer is None or not on_it or not isinstance(self._ticket, OrderSlips):
            return ()
        left, top = self._ticket_area.topleft
        return self._ticket.listing((pointer[0] - left, pointer[1] - top))

    def _goal(
        self, surface: pygame.Surface, area: pygame.Rect, y: int, layout: Layout, view: View
    ) -> int:
        room = pygame.Rect(area.x, y, area.width, area.height)
        clock = self._text.height(layout.text) + 3 * layout.text
        below = clock + self._seats.height(layout, len(view.seats))
        assert self._ticket is not None  # noqa: S101 - since `draw`
        drawn = self._draw_ticket(self._ticket, room, layout, area.bottom - y - below)
        room.height = drawn.get_height()
        surface.blit(drawn, room)
        self._ticket_area = room.move(layout.panel.topleft)
        return room.bottom + layout.text * 2 // 3

    def _draw_ticket(
        self, ticket: Ticket | OrderSlips, room: pygame.Rect, layout: Layout, free: int
    ) -> pygame.Surface:
        """Draw the ticket on a surface of its own: it changes far less often than the seats."""
        shown = (room.size, layout, free, ticket.redraw_key(self._settled))
        if self._ticket_drawn is None or self._ticket_drawn[0] != shown:
            canvas = pygame.Surface(room.size)
            canvas.fill(PANEL)
            height = ticket.draw(canvas, canvas.get_rect(), layout, self._settled, free)
            room.height = min(height, room.height)
            self._ticket_drawn = shown, canvas.subsurface((0, 0), room.size)
        return self._ticket_drawn[1]

    def _clock(
        self, surface: pygame.Surface, area: pygame.Rect, y: int, layout: Layout, view: View
    ) -> int:
        """Draw the step counter with its limit, and what moves the clock."""
        size, small = layout.text, max(10, layout.text - 3)
        counted = self._counted(view, size, area.width)
        self._put(surface, counted, (area.x, y), size, TEXT)
        if view.clock:
            words = self._text.line(view.clock.replace("_", " "), small, FAINT)
            if words.get_width() <= area.width - self._text.width(counted, size) - size // 2:
                surface.blit(words, words.get_rect(topright=(area.right, y + 2)))
        y += self._text.height(size) + 2
        thick = max(5, size // 2)
        if view.max_steps:
            line = pygame.Rect(area.x, y, area.width, thick)
            share = view.step / view.max_steps
            late = round(min(1.0, max(0.0, share - 0.5) * 2) * 16) / 16
            bar(surface, line, share, mixed(GOOD, BAD, late), TRACK)
            y += thick + 4
        return y + size * 2 // 3

    def _counted(self, view: View, size: int, width: int) -> str:
        """Return the step, its limit and the time left, or the part of that that fits."""
        if not view.max_steps:
            return f"Step {view.step}"
        short = f"{view.step} / {view.max_steps}"
        words = [f"Step {view.step} of {view.max_steps}", short]
        if view.step_seconds is not None:
            # A lying server's limit may be too large for a float.
            steps = min(max(0, view.max_steps - view.step), MAX_STEPS)
            left = _duration(ceil(steps * view.step_seconds))
            words = [f"{words[0]} · {left} left", f"{short} · {left}", *words]
        return next((w for w in words if self._text.width(w, size) <= width), short)

    def _chat(
        self, surface: pygame.Surface, area: pygame.Rect, y: int, layout: Layout, view: View
    ) -> None:
        """Draw the newest lines that fit, the last one at the bottom."""
        size = max(10, layout.text - 2)
        step = self._text.height(size)
        room = max(0, (area.bottom - y) // step)
        lines: list[tuple[str, Colour]] = []
        colours = {**self._colours(view), "": ACCENT}
        for name, text in reversed(view.chat):
            said = text if name == NEWS else f"{name or 'Operator'}: {text}"
            wrapped = self._text.wrap(said, size, area.width, 3)
            if len(lines) + len(wrapped) > room:
                break
            colour = mixed(colours.get(name, FAINT), TEXT, 0.25 if name else 0.0)
            lines = [*((line, colour) for line in wrapped), *lines]
        y = area.bottom - len(lines) * step
        for i, (line, colour) in enumerate(lines):
            self._put(surface, line, (area.x, y + i * step), size, colour)

    def _colours(self, view: View) -> dict[str, Colour]:
        players = {p: seat_ink(i) for i, p in enumerate(view.world.players)}
        names = {s.name: players.get(s.player, FAINT) for s in view.seats}
        return {**players, **names}


def _duration(seconds: int) -> str:
    """Return seconds as `7 s` or `2:05`."""
    return f"{seconds} s" if seconds < 60 else f"{seconds // 60}:{seconds % 60:02}"
