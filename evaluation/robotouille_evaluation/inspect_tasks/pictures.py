"""Pictures of states, drawn as the window draws them."""

from __future__ import annotations

import base64
import io

from robotouille import State
from robotouille_client.window import require_pygame

__all__ = ["Pictures"]

SIZE = (640, 244)
"""Pixels; of it, the kitchen is kept. Inspect's viewer folds what is higher."""
FRAME = 12


class Pictures:
    """Draws the kitchens of one episode.

    They are JPEG of about 12 kB, made in a millisecond: PNG takes some tens of them, and all other
    episodes of the process would have to wait.

    Raises:
        MissingExtraError: pygame is not installed.
    """

    def __init__(self) -> None:
        require_pygame("a picture of a state")
        import pygame

        from robotouille_client.window.drawing.painter import Painter

        self._painter = Painter()
        self._surface = pygame.Surface(SIZE)

    def data_uri(self, state: State) -> str:
        """A state as `data:image/jpeg;base64,…`."""
        import pygame

        from robotouille_client.window.view import View

        self._painter.paint(self._surface, View(state.world, state))
        kitchen = self._painter.layout(SIZE, state.world).kitchen.inflate(FRAME, FRAME)
        shown = self._surface.subsurface(kitchen.clip(self._surface.get_rect()))
        file = io.BytesIO()
        pygame.image.save(shown, file, "state.jpg")
        return f"data:image/jpeg;base64,{base64.b64encode(file.getvalue()).decode()}"
