"""Small pictures of tasks, for menus."""

from __future__ import annotations

from functools import lru_cache

import pygame

from robotouille.domain.loading import load_task
from robotouille.errors import RobotouilleError
from robotouille.world.world import World
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.view import View

__all__ = ["thumbnail"]


@lru_cache(maxsize=32)
def thumbnail(task: str, width: int, rendering: str = "") -> pygame.Surface | None:
    """A task's kitchen as it begins; None where the task cannot be loaded."""
    try:
        world = World(load_task(task))
    except RobotouilleError:
        return None
    painter = Painter(rendering)
    whole = pygame.Surface((640, 400))
    painter.paint(whole, View(world, world.initial))
    kitchen = painter.layout(whole.get_size(), world).kitchen.clip(whole.get_rect())
    height = max(1, round(width * kitchen.height / kitchen.width))
    return pygame.transform.smoothscale(whole.subsurface(kitchen), (width, height))
