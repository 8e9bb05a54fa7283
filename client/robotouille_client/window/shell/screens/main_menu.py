"""The first screen."""

from __future__ import annotations

from functools import cache

import pygame

from robotouille.resources import data_folder
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button
from robotouille_client.window.shell.settings import Settings

__all__ = ["menu"]

EMBLEM = ("assets", "kitchen", "app_icon.svg")
SIDE = 280


def menu(settings: Settings, message: str = "") -> Form:
    """What one can do; who is here for the first time is led to the tutorial."""
    rows = [
        Button("Play here", "play"),
        Button("Join by code", "join"),
        Button("Open a kitchen on a server", "open"),
        Button("Kitchens on a server", "lobby"),
        Button("Replays", "replays"),
        Button("Tutorial: two minutes", "tutorial"),
        Button("Settings", "settings"),
        Button("Quit", "quit"),
    ]
    form = Form(f"Hello, {settings.name}", rows, cancel="quit", picture=_emblem())
    if not settings.learned:
        form.focus(rows[5])
    form.message = message
    return form


@cache
def _emblem() -> pygame.Surface | None:
    folder, kitchen, file = EMBLEM
    try:
        return pygame.image.load_sized_svg(data_folder(folder) / kitchen / file, (SIDE, SIDE))
    except (pygame.error, OSError):
        return None
