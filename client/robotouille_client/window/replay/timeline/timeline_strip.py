"""The timeline below the kitchen: where one is, what every seat did, and the mouse on it."""

from __future__ import annotations

import pygame

from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    FAINT,
    INK,
    PANEL,
    PAPER,
    SEATS,
    TEXT,
    mixed,
)
from robotouille_client.window.replay.history.history import History
from robotouille_client.window.replay.playhead import Playhead
from robotouille_client.window.replay.timeline.key_help import draw_key_help
from robotouille_client.window.replay.timeline.lanes import Lanes
from robotouille_client.window.replay.timeline.log_panel import LogPanel
from robotouille_client.window.replay.timeline.readout import draw_readout, readout_words
from robotouille_client.window.replay.timeline.scale import Scale
from robotouille_client.window.replay.timeline.steps_curve import StepsCurve
from robotouille_client.window.replay.timeline.words import entry_words, name_of, time_words
from robotouille_client.window.replay.viewer_keys import ViewerKeys
from robotouille_client.window.replay.viewer_state import ViewerState
from robotouille_client.window.view import View

__all__ = ["TimelineStrip"]

READOUT, ROW, CURVE, AXIS = 1.8, 1.5, 2.8, 1.25
"""Heights, as multiples of the text size."""
HEAD_ROW = 0.5
"""The height of the marks that are nobody's, as part of a lane's."""
NEAR = 4
"""Pixels from which a mark is meant."""
MAX_TOLD = 5
"""Entries that the pointer tells of."""
ZOOM = 0.8


class TimelineStrip:
    """A strip for a window on a history.

    `area` is where it was drawn last, `offset` how many pixels of the window are left of what it
    was drawn on.

    Args:
        keys: None where another strip of the same window has them.
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
        self._curve = curve
        self._lanes = Lanes(history)
        self._log = LogPanel(history)
        self._scale = Scale()
        self.area = pygame.Rect(0, 0, 0, 0)
        self.offset = 0
        self._lane_area = pygame.Rect(0, 0, 0, 0)
        self._row = 1
        self._head_row = 1
        self._button = pygame.Rect(0, 0, 0, 0)
        self._pointer: tuple[int, int] | None = None
        self._dragging = False
        self._silent = False

    @property
    def lines(self) -> float:
        """The strip's height, as a multiple of the window's text size."""
        curve = CURVE if self._curve.begun else 0.0
        return READOUT + curve + ROW * (len(self._history.lanes) + HEAD_ROW) + AXIS

    def tick(self) -> None:
        """A frame passes: a key that is held does again what it does."""
        if self._keys is not None:
            self._keys.tick()

    # Drawing

    def seen(self) -> object:
        """What can be seen of it, as a value; events aside, after which a window draws anyway."""
        history, playhead, state, scale = self._history, self._playhead, self._state, self._scale
        step = min(playhead.step, history.length)
        return (
            readout_words(history, playhead, state), state.message, state.help, state.log,
            playhead.playing, scale.x(playhead.position), scale.first, scale.shown,
            history.length, len(history.marks), history.seats(step),
            self._curve.begun, len(self._curve.known),
        )  # fmt: skip

    def draw(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int, view: View
    ) -> None:
        """Fill an area of the window; `size` is that of the window's text."""
        self.area, self.offset = area, target.get_offset()[0]
        self._place(area, size)
        target.fill(PANEL, area)
        target.fill(INK, (area.x, area.y, area.width, 2))
        readout = pygame.Rect(area.x, area.y, area.width, round(READOUT * size))
        self._button = draw_readout(
            target, readout, text, size, self._history, self._playhead, self._state
        )
        self._curve.draw(target, self._curve_area(size), text, size, self._scale)
        followed = self._state.followed
        players = self._history.world.players
        place = players.index(followed) if followed in players else None
        self._lanes.draw(target, self._lane_area, self._scale, self._row, self._head_row, place)
        self._names(target, area, text, size, view.step)
        self._span(target)
        self._axis(target, area, text, size)
        self._head(target, size)
        if self._state.log:
            beside = pygame.Rect(area.right, 0, target.get_width() - area.right, 0)
            beside.height = target.get_height()
            self._log.draw(target, beside, text, size, view.step, followed)
        self._tooltip(target, area, text, size)
        if self._state.help and self._keys is not None:
            draw_key_help(target, text, size, self._keys.help)

    def _place(self, area: pygame.Rect, size: int) -> None:
        """Work out where everything is."""
        self._row = max(6, round(ROW * size))
        left = area.x + min(round(size * 7.5), area.width // 4)
        width = max(1, area.right - left - size)
        curve = round(CURVE * size) if self._curve.begun else 0
        top = area.y + round(READOUT * size) + curve
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
        """Whose lane is whose, with the seat's colour."""
        step = min(step, self._history.length)
        for place, seat in enumerate(self._history.seats(step)):
            top = self._lane_area.top + self._head_row + place * self._row
            followed = self._state.followed in (None, seat.player)
            chip = pygame.Rect(area.x + size // 2, top + 2, max(4, size // 3), self._row - 4)
            target.blit(box(chip.size, SEATS[place % len(SEATS)], 2), chip)
            room = self._scale.left - chip.right - size
            words = text.fit(seat.name or seat.player, max(10, size - 2), room)
            drawn = text.line(words, max(10, size - 2), TEXT if followed else FAINT)
            target.blit(drawn, drawn.get_rect(midleft=(chip.right + size // 3, chip.centery)))

    def _span(self, target: pygame.Surface) -> None:
        """The span that is to be exported."""
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
        """Step numbers below the lanes."""
        small, scale = max(9, size - 4), self._scale
        every = _round_number(scale.shown * 5 * small / scale.width)
        y = self._lane_area.bottom
        for step in range(-(-int(scale.first) // every) * every, int(scale.last) + 1, every):
            x = scale.x(step)
            pygame.draw.line(target, FAINT, (x, y), (x, y + small // 3))
            number = text.line(str(step), small, FAINT)
            target.blit(number, number.get_rect(midtop=(x, y + small // 3)))

    def _head(self, target: pygame.Surface, size: int) -> None:
        """Where one is."""
        x = self._scale.x(self._playhead.position)
        top, bottom = self._lane_area.top, self._lane_area.bottom + 2
        if self._curve.begun:
            top -= round(CURVE * size)
        pygame.draw.line(target, INK, (x - 1, top), (x - 1, bottom), 4)
        pygame.draw.line(target, ACCENT, (x, top), (x, bottom), 2)
        half = max(4, size // 3)
        knob = [(x - half, bottom + half), (x + half, bottom + half), (x, bottom - half // 2)]
        pygame.draw.polygon(target, ACCENT, knob)

    # What the pointer tells

    def _tooltip(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int
    ) -> None:
        pointer = self._pointer
        hidden = self._silent or self._state.help
        if pointer is None or hidden or not self._on_lanes(pointer):
            return
        step, small = self._step_at(pointer), max(10, size - 1)
        most = min(area.width - 2 * size, 26 * size)
        lines = [
            line for words in self._told(step, pointer) for line in text.wrap(words, small, most, 2)
        ]
        high, pad = text.height(small), size // 2
        width = max(text.width(line, small) for line in lines) + 2 * pad
        card = pygame.Rect(0, 0, width, high * len(lines) + pad)
        card.midbottom = (self._scale.x(step), area.top + round(READOUT * size) - 4)
        if self._curve.begun:
            card.bottom = self._curve_area(size).top - 4
        card.clamp_ip(pygame.Rect(area.x + 2, 0, area.width - 4, area.bottom))
        x = self._scale.x(step)
        pygame.draw.line(target, PAPER, (x, self._lane_area.top), (x, self._lane_area.bottom))
        target.blit(box(card.size, (*INK, 240), 6, mixed(INK, PAPER, 0.4)), card)
        for i, line in enumerate(lines):
            drawn = text.line(line, small, ACCENT if i == 0 else TEXT)
            target.blit(drawn, (card.x + pad, card.y + pad // 2 + i * high))

    def _told(self, step: int, pointer: tuple[int, int]) -> list[str]:
        """Step and time, what the seat under the pointer does, and what happened."""
        history = self._history
        step = min(step, history.length)
        left = self._curve.words(step)
        head = f"Step {step} · {time_words(history.times[step])}{f' · {left}' if left else ''}"
        player = self._player_at(pointer)
        if player is None:
            entries = history.entries(step)
            told = [_line(history, entry.player, step, entry_words(entry)) for entry in entries]
        else:
            entries = tuple(e for e in history.entries(step) if e.player in (player, ""))
            did = history.activity(player, step) if step else None
            does = "has not begun" if not step else _DOES.get(did or "", "was not seen")
            told = [f"{name_of(history, player, step)} {does}", *map(entry_words, entries)]
        more = [f"and {len(told) - MAX_TOLD} more"] if len(told) > MAX_TOLD else []
        return [head, *told[:MAX_TOLD], *more]

    # The mouse

    def handle(self, event: pygame.Event, area: pygame.Rect) -> bool:
        """Whether an event was for the strip, the log or the viewer's keys."""
        if event.type == pygame.MOUSEMOTION:
            self._pointer, self._silent = event.pos, False
            if self._dragging:
                self._playhead.seek(self._scale.step(event.pos[0]))
            return self._dragging
        if event.type == pygame.MOUSEBUTTONUP:
            dragged, self._dragging = self._dragging, False
            return dragged
        if event.type in (pygame.WINDOWLEAVE, pygame.WINDOWFOCUSLOST):
            self._pointer, self._dragging = None, False
        if event.type == pygame.MOUSEBUTTONDOWN:
            return self._press(event, area)
        if event.type == pygame.MOUSEWHEEL:
            return self._wheel(event.y, area)
        taken = self._keys is not None and self._keys.handle(event)
        self._silent = self._silent or taken  # Whoever uses keys is not asking what is there.
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
        if not area.collidepoint(event.pos):
            return False
        if event.button == 1 and self._button.collidepoint(event.pos):
            self._playhead.toggle()
        elif event.button == 1 and self._on_lanes(event.pos):
            self._dragging = True
            self._playhead.seek(self._step_at(event.pos))
        return True

    def _wheel(self, notches: int, area: pygame.Rect) -> bool:
        pointer = self._pointer
        if pointer is None or not area.collidepoint(pointer):
            return False
        self._scale.zoom(pointer[0], ZOOM**notches)
        return True

    def _on_lanes(self, position: tuple[int, int]) -> bool:
        area = self._lane_area
        curve = round(area.height if self._curve.begun else 0)
        return area.inflate(0, 4).collidepoint(position) or (
            bool(curve) and area.left <= position[0] <= area.right
            and area.top - round(CURVE * self._row / ROW) <= position[1] < area.top
        )  # fmt: skip

    def _player_at(self, position: tuple[int, int]) -> str | None:
        place = (position[1] - self._lane_area.top - self._head_row) // self._row
        players = self._history.world.players
        return players[place] if 0 <= place < len(players) else None

    def _step_at(self, position: tuple[int, int]) -> int:
        """The step under a pixel; that of a mark which is quite near."""
        player = self._player_at(position)
        near = self._scale.step(position[0] - NEAR), self._scale.step(position[0] + NEAR)
        mark = self._history.next_mark(near[0] - 1, player or "")
        if mark is not None and mark.step <= near[1]:
            return mark.step
        return self._scale.step(position[0])


_DOES = {
    "acted": "acted",
    "busy": "was working or walking",
    "waiting": "was waiting, or was refused something",
    "idle": "did nothing",
    "away": "was away",
    "substituted": "had a stand-in",
}


def _line(history: History, player: str, step: int, words: str) -> str:
    return f"{name_of(history, player, step)}: {words}" if player else words


def _round_number(at_least: float) -> int:
    """The first of 1, 2, 5, 10, 20, … that is not smaller."""
    ten = 1
    while True:
        for first in (1, 2, 5):
            if first * ten >= at_least:
                return first * ten
        ten *= 10
