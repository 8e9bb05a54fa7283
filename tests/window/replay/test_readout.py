"""The card with the messages and jobs of the replay viewer."""

from __future__ import annotations

import pygame

from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import Colour
from robotouille_client.window.replay.readout import Toast
from robotouille_client.window.replay.viewer_state import JobProgress, ViewerState


class Recorded(Typesetter):
    """Typesetter that stores what it draws."""

    def __init__(self) -> None:
        super().__init__()
        self.drawn: list[str] = []

    def line(self, words: str, size: int, ink: Colour) -> pygame.Surface:
        self.drawn.append(words)
        return super().line(words, size, ink)


def test_the_words_of_a_job_are_not_cut_off() -> None:
    state, text = ViewerState(lambda: 0.0), Recorded()
    words = "Saving steps 0 to 104 as a video"
    state.jobs["video"] = JobProgress(words, lambda: None, 0.5)
    for size in (11, 15, 24):
        Toast(state).draw(pygame.Surface((1280, 720)), pygame.Rect(0, 0, 1280, 720), text, size)
        assert words in text.drawn
        text.drawn.clear()
