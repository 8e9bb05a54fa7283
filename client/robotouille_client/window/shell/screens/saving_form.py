"""A video is being written: how far it is, and whether it is to be given up."""

from __future__ import annotations

import pygame

from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button, Look, Row, Words
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.theme import ACCENT, TEXT, TRACK

__all__ = ["SavingForm"]


class SavingForm(Form):
    """Says what is written, and how much of it is: `percent`."""

    def __init__(self, words: str) -> None:
        self.percent = 0
        self._shown = -1
        rows = [Words(words), _Bar(self), Button("Cancel", "back")]
        super().__init__("Saving the video …", rows, idle=self._changed)

    def _changed(self) -> bool:
        before, self._shown = self._shown, self.percent
        return before != self._shown


class _Bar(Row):
    focusable = False

    def __init__(self, form: SavingForm) -> None:
        super().__init__("")
        self._form = form

    def draw(self, target: pygame.Surface, area: pygame.Rect, look: Look) -> None:
        said = look.text.line(f"{self._form.percent} %", look.size, TEXT)
        room = look.text.width("100 %", look.size) + look.size
        high = look.size * 2 // 3
        track = pygame.Rect(area.x, 0, area.width - room, high)
        track.centery = area.y + area.height // 2 - look.size // 4
        target.blit(box(track.size, TRACK, high // 2), track)
        done = pygame.Rect(track.topleft, (track.width * self._form.percent // 100, high))
        if done.width >= high:
            target.blit(box(done.size, ACCENT, high // 2), done)
        target.blit(said, said.get_rect(midright=(area.right, track.centery)))
