"""A video is being written: how far it is, and whether it is to be given up."""

from __future__ import annotations

import pygame

from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button, Look, Row, Words
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.theme import ACCENT, TRACK

__all__ = ["SavingForm"]


class SavingForm(Form):
    """Says what is written, and how much of it is."""

    def __init__(self, words: str) -> None:
        self._bar = _Bar()
        super().__init__("Saving the video …", [Words(words), self._bar, Button("Cancel", "back")])
        self.told(0.0)

    def told(self, share: float) -> None:
        """So much of it is written, of 1."""
        self._bar.share = share
        self.message = f"{round(100 * share)} %"


class _Bar(Row):
    focusable = False

    def __init__(self) -> None:
        super().__init__("")
        self.share = 0.0

    def draw(self, target: pygame.Surface, area: pygame.Rect, look: Look) -> None:
        track = area.inflate(0, -(area.height // 3))
        target.blit(box(track.size, TRACK, track.height // 2), track)
        done = pygame.Rect(track.topleft, (round(track.width * self.share), track.height))
        if done.width >= done.height:
            target.blit(box(done.size, ACCENT, done.height // 2), done)
