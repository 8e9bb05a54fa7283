"""Words at the lower end of the panel: what has happened, and what is being done, with bars."""

from __future__ import annotations

from collections.abc import Callable

import pygame

from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, FAINT, INK, PANEL, TEXT, TRACK
from robotouille_client.window.replay.viewer_state import JobProgress, ViewerState

__all__ = ["Toast"]

MAX_LINES = 6
_STOP = "click here: stop"


class Toast:
    """Draws the message of a viewer and its jobs, and knows where one clicks to stop one."""

    def __init__(self, state: ViewerState) -> None:
        self._state = state
        self._stops: list[tuple[pygame.Rect, Callable[[], None]]] = []
        self._area = pygame.Rect(0, 0, 0, 0)

    def covers(self, position: tuple[int, int]) -> bool:
        """Whether a pixel is in the card as it was drawn last."""
        return self._area.collidepoint(position)

    def seen(self) -> object:
        """What can be seen of it, as a value."""
        jobs = tuple((j.words, j.done and round(j.done, 2)) for j in self._state.jobs.values())
        return self._state.message, jobs

    def draw(
        self, target: pygame.Surface, room: pygame.Rect, text: Typesetter, size: int
    ) -> pygame.Rect:
        """A card in the lower left corner of the room that there is; where it is."""
        jobs, message = tuple(self._state.jobs.values()), self._state.message
        self._stops = []
        self._area = pygame.Rect(room.bottomleft, (0, 0))
        if not jobs and not message:
            return self._area
        pad, line = size // 2, text.height(size)
        most = min(room.width, 60 * size) - 2 * pad
        lines = text.wrap(message, size, most, MAX_LINES) if message else ()
        bars = line + size
        wide = max(
            [text.width(each, size) for each in lines]
            + [text.width(f"{job.words}   {_STOP}", size) for job in jobs]
            + [min(most, 14 * size)]
        )
        card = pygame.Rect(room.x, 0, min(most, wide) + 2 * pad, 0)
        card.height = len(lines) * line + len(jobs) * bars + pad
        card.bottom = room.bottom
        self._area = card
        target.blit(box(card.size, (*PANEL, 240), 6, ACCENT), card)
        y = card.y + pad // 2
        for each in lines:
            target.blit(text.line(each, size, ACCENT), (card.x + pad, y))
            y += line
        for job in jobs:
            place = pygame.Rect(card.x + pad, y, card.width - 2 * pad, bars)
            self._job(target, place, text, job, size)
            y += bars
        return card

    def _job(
        self,
        target: pygame.Surface,
        area: pygame.Rect,
        text: Typesetter,
        job: JobProgress,
        size: int,
    ) -> None:
        stop = text.line(_STOP, max(9, size - 2), FAINT)
        place = stop.get_rect(topright=(area.right, area.y + 2))
        words = text.fit(job.words, size, area.width - stop.get_width() - size)
        target.blit(text.line(words, size, TEXT), area)
        target.blit(stop, place)
        pygame.draw.line(target, FAINT, (place.x, place.bottom), (place.right, place.bottom))
        self._stops.append((place.inflate(size, size // 2), job.stop))
        bar = pygame.Rect(area.x, area.bottom - size * 3 // 4, area.width, max(3, size // 3))
        target.fill(INK, bar)
        if job.done is None:
            target.fill(TRACK, bar)
        else:
            target.fill(ACCENT, (*bar.topleft, round(bar.width * min(1.0, job.done)), bar.height))

    def press(self, position: tuple[int, int]) -> bool:
        """Whether a click was on a job's way to stop it."""
        for place, stop in self._stops:
            if place.collidepoint(position):
                stop()
                return True
        return False
