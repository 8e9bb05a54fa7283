"""One picture of a state."""

from __future__ import annotations

from typing import Any

import pygame

from robotouille.world.world import State
from robotouille_client.window.drawing.painter import paint
from robotouille_client.window.view import View

__all__ = ["still"]

SIZE = (960, 540)


def still(state: State, step: int, size: tuple[int, int] = SIZE) -> Any:
    """A state as an array of pixels (NumPy): (height, width, 3), bytes."""
    surface = pygame.Surface(size)
    paint(surface, View(world=state.world, state=state, step=step))
    return pygame.surfarray.array3d(surface).swapaxes(0, 1).copy()
