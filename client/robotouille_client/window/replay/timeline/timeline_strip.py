"""Timeline below the kitchen: the playhead, what every seat did, buttons and the mouse."""

from __future__ import annotations

import pygame

from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, FAINT, INK, PANEL, PAPER, SEATS, TEXT
from robotouille_client.window.replay.histories.history import History
from robotouille_client.window.replay.log_panel import LogPanel
from robotouille_client.window.replay.readout import (
    Toast,
    draw_readout,
    draw_tooltip,
    readout_parts,
    summary_at,
)
from robotouille_client.window.replay.timeline.button_row import ButtonRow, ButtonsLook
from robotouille_client.window.replay.timeline.lanes import Lanes, Scale
from robotouille_client.window.replay.timeline.legend import draw_key_help
from robotouille_client.window.replay.timeline.steps_to_go import StepsCurve
from robotouille_client.window.replay.viewer_keys import ViewerKeys
from robotouille_client.window.replay.viewer_state import Playhead, ViewerState
from robotouille_client.window.view import View

# Heights, as multiples of the text size.
EDGE, READOUT, ROW, CURVE, AXIS = 0.4, 1.9, 1.5, 2.8, 1.25
# Height of all lanes together, as a multiple of the text size; many lanes get lower.
MAX_ROWS = 6.0
MIN_ROW = 0.8
# Height of the marks that belong to no player, as a share of a lane's.
HEAD_ROW = 0.5
# Room next to the buttons, as a multiple of the text size.
MIN_WORDS = 5.5
# Pixels within which the mouse means a mark.
NEAR = 4
ZOOM = 0.8


class TimelineStrip:
    """Strip of a window on a history.

    Attributes:
        curve: Steps to go.
        area: Area in which the strip was drawn last.
        offset: Pixels between the window's left edge and that of the strip's surface.

    Args:
        keys: Keys of the viewer; None if another strip of the window has them.
    """

    def __init__(
        self,
        history: History,
        playhead: Playhead,
        state: ViewerState,
        keys: ViewerKeys | None,
        curve: StepsCurve,
    ) -> None:
        self._history = history
        self._playhead = playhead
        self._state = state
        self._keys = keys
        self.curve = curve
        self._lanes = Lanes(history)
        self._log = LogPanel(history)
        self._scale = Scale()
        self.area = pygame.Rect(0, 0, 0, 0)
        self.offset = 0
        self._lane_area = pygame.Rect(0, 0, 0, 0)
        self._row = 1
        self._head_row = 1
        self._curve_high = 0
        self._buttons = None if keys is None else ButtonRow(keys)
        self._toast = None if keys is None else Toast(state)
        self._pointer: tuple[int, int] | None = None
        self._dragging = False
        self._silent = False
        self._pressed: int | None = None

    @property
    def lines(self) -> float:
        """Height as a multiple of the window's text size."""
        curve = CURVE if self.curve.begun else 0.0
        lanes = self._row_lines * (len(self._history.lanes) + HEAD_ROW)
        return EDGE + curve + lanes + AXIS + READOUT

    @property
    def _row_lines(self) -> float:
        return max(MIN_ROW, min(ROW, MAX_ROWS / len(self._history.lanes)))

    def tick(self) -> None:
        """Advance by one frame: repeat a held key."""
        if self._keys is not None:
            self._keys.tick()

    # Drawing

    def redraw_key(self) -> object:
        """Return a value that changes whenever the picture would, except after events."""
        history, playhead, state, scale = self._history, self._playhead, self._state, self._scale
        step = min(playhead.step, history.length)
        return (
            readout_parts(history, playhead, state), state.help, state.log,
            None if self._toast is None else self._toast.redraw_key(),
            playhead.playing, scale.x(playhead.position), scale.first, scale.shown,
            history.length, len(history.marks), history.seats(step), self.curve.redraw_key(),
        )  # fmt: skip

    def draw(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int, view: View
    ) -> None:
        """Fill an area of the window; `size` is the window's text size."""
        self.area, self.offset = area, target.get_offset()[0]
        self._place(area, size)
        target.fill(PANEL, area)
        target.fill(INK, (area.x, area.y, area.width, 2))
        self._bottom_row(target, area, text, size)
        self.curve.draw(target, self._curve_area(size), text, size, self._scale)
        panel = pygame.Rect(area.right, 0, target.get_width() - area.right, target.get_height())
        followed = self._state.followed
        players = self._history.world.players
        place = players.index(followed) if followed in players else None
        self._lanes.draw(target, self._lane_area, self._scale, self._row, self._head_row, place)
        self._names(target, area, text, size, view.step)
        self._span(target)
        self._axis(target, area, text, size)
        self._head(target, size)
        if self._state.log:
            self._log.draw(target, panel, text, size, view.step, followed)
        if self._toast is not None:
            self._toast.draw(target, panel.inflate(-size, -size), text, size)
        self._tooltip(target, area, text, size)
        if self._state.help and self._keys is not None:
            draw_key_help(target, text, size, self._keys.help)

    def _bottom_row(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int
    ) -> None:
        """Draw the buttons and the readout at the lower edge, where they stay in place."""
        row = pygame.Rect(area.x, 0, area.width, round(READOUT * size))
        row.bottom = area.bottom - 1
        right = row.x
        if self._buttons is not None:
            buttons = row.copy()
            buttons.width -= round(MIN_WORDS * size)
            right = self._buttons.draw(target, buttons, text, size, self._look())
        words = pygame.Rect(right + size // 2, row.y, 0, row.height)
        words.width = max(1, row.right - size // 2 - words.x)
        history = self._history
        parts = readout_parts(history, self._playhead, self._state)
        ended = history.outcome is not None and self._playhead.step >= history.length
        draw_readout(target, words, text, size, parts, ended=ended)

    def _look(self) -> ButtonsLook:
        state = self._state
        on = {
            pygame.K_f: state.followed is not None, pygame.K_l: state.log,
            pygame.K_g: self.curve.begun, pygame.K_i: state.first is not None,
            pygame.K_o: state.last is not None, pygame.K_h: state.help,
        }  # fmt: skip
        lit = frozenset(key for key, is_on in on.items() if is_on)
        live = self._playhead.follows and self._history.outcome is None
        return ButtonsLook(self._playhead.playing, live, lit)

    def _place(self, area: pygame.Rect, size: int) -> None:
        self._row = max(6, round(self._row_lines * size))
        left = area.x + min(round(size * 7.5), area.width // 4)
        width = max(1, area.right - left - size)
        self._curve_high = round(CURVE * size) if self.curve.begun else 0
        top = area.y + round(EDGE * size) + self._curve_high
        self._head_row = round(self._row * HEAD_ROW)
        high = self._head_row + self._row * len(self._history.lanes)
        self._lane_area = pygame.Rect(left - size, top, width + 2 * size, high)
        self._scale.place(left, width, self._playhead.first, self._playhead.length)
        if not self._dragging:
            self._scale.reveal(self._playhead.position)

    def _curve_area(self, size: int) -> pygame.Rect:
        high = round(CURVE * size)
        return pygame.Rect(self._scale.left, self._lane_area.top - high, self._scale.width, high)

    def _names(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int, step: int
    ) -> None:
        """Draw the name of each lane in its seat's colour."""
        step = min(step, self._history.length)
        for place, seat in enumerate(self._history.seats(step)):
            top = self._lane_area.top + self._head_row + place * self._row
            followed = self._state.followed in (None, seat.player)
            chip = pygame.Rect(area.x + size // 2, top + 2, max(4, size // 3), self._row - 4)
            target.blit(box(chip.size, SEATS[place % len(SEATS)], 2), chip)
            room = self._scale.left - chip.right - size
            letters = max(7, min(max(10, size - 2), self._row - 2))
            words = text.fit(seat.name or seat.player, letters, room)
            drawn = text.line(words, letters, TEXT if followed else FAINT)
            target.blit(drawn, drawn.get_rect(midleft=(chip.right + size // 3, chip.centery)))

    def _span(self, target: pygame.Surface) -> None:
        state, area = self._state, self._lane_area
        if state.first is None and state.last is None:
            return
        first, last = state.span(self._history.length)
        left, right = self._scale.x(first), self._scale.x(last)
        left = min(max(left, self._scale.left), self._scale.left + self._scale.width)
        right = min(max(right, left), self._scale.left + self._scale.width)
        target.blit(box((max(1, right - left), area.height), (*PAPER, 40), 0), (left, area.top))
        for x, inwards in ((left, 1), (right, -1)):
            pygame.draw.line(target, PAPER, (x, area.top), (x, area.bottom), 2)
            for y in (area.top, area.bottom - 1):
                pygame.draw.line(target, PAPER, (x, y), (x + 5 * inwards, y), 2)

    def _axis(self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int) -> None:
        small, scale = max(9, size - 4), self._scale
        every = _round_number(scale.shown * 5 * small / scale.width)
        y = self._lane_area.bottom
        for step in range(-(-int(scale.first) // every) * every, int(scale.last) + 1, every):
            x = scale.x(step)
            pygame.draw.line(target, FAINT, (x, y), (x, y + small // 3))
            number = text.line(str(step), small, FAINT)
            target.blit(number, number.get_rect(midtop=(x, y + small // 3)))

    def _head(self, target: pygame.Surface, size: int) -> None:
        x = self._scale.x(self._playhead.position)
        top, bottom = self._lane_area.top, self._lane_area.bottom + 2
        if self.curve.begun:
            top -= round(CURVE * size)
        pygame.draw.line(target, INK, (x - 1, top), (x - 1, bottom), 4)
        pygame.draw.line(target, ACCENT, (x, top), (x, bottom), 2)
        half = max(4, size // 3)
        knob = [(x - half, bottom + half), (x + half, bottom + half), (x, bottom - half // 2)]
        pygame.draw.polygon(target, ACCENT, knob)

    # The tooltip

    def _tooltip(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int
    ) -> None:
        pointer, room = self._pointer, pygame.Rect(area.x + 2, 0, area.width - 4, area.bottom)
        if pointer is None or self._silent or self._state.help:
            return
        does = "" if self._buttons is None else self._buttons.tooltip(pointer)
        if does and self._pressed is None:
            top = area.bottom - round(READOUT * size) - 4
            draw_tooltip(target, room, (pointer[0], top), [does], text, size)
        elif self._on_lanes(pointer):
            step = self._step_at(pointer)
            player, x = self._player_at(pointer), self._scale.x(step)
            summary = summary_at(self._history, step, player, self.curve.words(step))
            pygame.draw.line(target, PAPER, (x, self._lane_area.top), (x, self._lane_area.bottom))
            draw_tooltip(target, room, (x, area.top - 4), summary, text, size)

    # The mouse

    def handle(self, event: pygame.Event, area: pygame.Rect) -> bool:
        """Handle an event. Return whether it was for the strip, the log or the viewer's keys."""
        if event.type == pygame.MOUSEMOTION:
            self._pointer, self._silent = event.pos, False
            if self._buttons is None or self._buttons.at(event.pos) != self._pressed:
                self._pressed = None
            if self._dragging:
                self._playhead.seek(self._scale.step(event.pos[0]))
            return self._dragging
        if event.type == pygame.MOUSEBUTTONUP:
            dragged, self._dragging = self._dragging, False
            if self._keys is not None:
                self._keys.release()
            return dragged
        if event.type in (pygame.WINDOWLEAVE, pygame.WINDOWFOCUSLOST):
            self._pointer, self._dragging = None, False
        if event.type == pygame.MOUSEBUTTONDOWN:
            return self._press(event, area)
        if event.type == pygame.MOUSEWHEEL:
            return self._wheel(event.y, area)
        taken = self._keys is not None and self._keys.handle(event)
        self._silent = self._silent or taken  # Using keys hides the tooltip.
        return taken

    def _press(self, event: pygame.Event, area: pygame.Rect) -> bool:
        self._pointer = event.pos
        if self._state.help:
            self._state.help = False
            return True
        if self._state.log and self._log.covers(event.pos):
            step = self._log.step_at(event.pos)
            if step is not None and event.button == 1:
                self._playhead.seek(step, playing=False)
            return True
        if event.button == 1 and self._toast is not None and self._toast.press(event.pos):
            return True
        if not area.collidepoint(event.pos):
            return False
        key = None if self._buttons is None else self._buttons.at(event.pos)
        if key is not None and self._keys is not None:
            if event.button == 1:
                self._pressed = key  # A pressed button needs no tooltip.
                self._keys.press(key)
        elif event.button == 1 and self._on_lanes(event.pos):
            self._dragging = True
            self._playhead.seek(self._step_at(event.pos))
        return True

    def covers(self, position: tuple[int, int]) -> bool:
        """Return whether a pixel shows the strip, or what lies over the panel."""
        log = self._state.log and self._log.covers(position)
        toast = self._toast is not None and self._toast.covers(position)
        return log or toast or self._state.help or self.area.collidepoint(position)

    def _wheel(self, notches: int, area: pygame.Rect) -> bool:
        pointer = self._pointer
        if pointer is None or not area.collidepoint(pointer):
            return False
        self._scale.zoom(pointer[0], ZOOM**notches)
        return True

    def _on_lanes(self, position: tuple[int, int]) -> bool:
        area = self._lane_area
        return area.inflate(0, 4).collidepoint(position) or (
            self.curve.begun and area.left <= position[0] <= area.right
            and area.top - self._curve_high <= position[1] < area.top
        )  # fmt: skip

    def place_of(self, step: int, lane: int = 0) -> tuple[int, int]:
        """Return the pixel of a step on a lane, as drawn last."""
        top = self._lane_area.top + self._head_row + lane * self._row
        return self._scale.x(step), top + self._row // 2

    def button(self, key: int) -> tuple[int, int] | None:
        """Return the pixel of a key's button, or None."""
        place = None if self._buttons is None else self._buttons.place(key)
        return None if place is None else place.center

    def _player_at(self, position: tuple[int, int]) -> str | None:
        place = (position[1] - self._lane_area.top - self._head_row) // self._row
        players = self._history.world.players
        return players[place] if 0 <= place < len(players) else None

    def _step_at(self, position: tuple[int, int]) -> int:
        """Return the step at a pixel, or that of a mark close by."""
        player = self._player_at(position)
        near = self._scale.step(position[0] - NEAR), self._scale.step(position[0] + NEAR)
        mark = self._history.next_mark(near[0] - 1, player or "")
        if mark is not None and mark.step <= near[1]:
            return mark.step
        return self._scale.step(position[0])


def _round_number(at_least: float) -> int:
    """Return the first of 1, 2, 5, 10, 20, … that is not smaller."""
    ten = 1
    while True:
        for first in (1, 2, 5):
            if first * ten >= at_least:
                return first * ten
        ten *= 10
