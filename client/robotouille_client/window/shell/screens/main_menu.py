"""The first screen."""

from __future__ import annotations

from functools import lru_cache

import pygame

from robotouille.resources import data_folder
from robotouille_client.window.forms.answers import Answer
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button
from robotouille_client.window.shell.settings import Settings

__all__ = ["menu", "quit_form"]

EMBLEM = ("assets", "kitchen", "app_icon.svg")


def menu(settings: Settings, message: str = "", chosen: object = None) -> Form:
    """What one can do; the last that was `chosen` has the focus, or the tutorial for who is here
    for the first time."""
    rows = [
        Button("Play here", Answer.PLAY),
        Button("Join by code", Answer.JOIN),
        Button("Open a kitchen on a server", Answer.OPEN),
        Button("Kitchens on a server", Answer.LOBBY),
        Button("Replays", Answer.REPLAYS),
        Button("Tutorial: two minutes", Answer.TUTORIAL),
        Button("Settings", Answer.SETTINGS),
        Button("Quit", Answer.QUIT),
    ]
    form = Form(
        f"Hello, {settings.preferences.name}", rows, cancel=Answer.ASK_TO_QUIT, picture=_emblem
    )
    last = next((row for row in rows if row.answer == chosen), None)
    if last is not None:
        form.focus(last)
    elif not settings.learned:
        form.focus(rows[5])
    form.message = message
    return form


def quit_form() -> Form:
    """Whether Escape was meant."""
    return Form("Leave Robotouille?", [Button("Stay", Answer.STAY), Button("Quit", Answer.QUIT)])


@lru_cache(maxsize=4)
def _emblem(room: tuple[int, int]) -> pygame.Surface | None:
    folder, kitchen, file = EMBLEM
    try:
        return pygame.image.load_sized_svg(data_folder(folder) / kitchen / file, (min(room),) * 2)
    except (pygame.error, OSError):
        return None
