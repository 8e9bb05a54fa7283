"""Pictures of states, drawn as the window draws them."""

from __future__ import annotations

import base64
import io

from robotouille import State
from robotouille_client.window import require_pygame

__all__ = ["Pictures"]

SIZE = (640, 360)


class Pictures:
    """Draws the states of one episode.

    They are JPEG of about 30 kB, made in 5 to 10 ms: PNG of the same size takes 50 ms, for which
    all other episodes of the process would have to wait.

    Raises:
        MissingExtraError: pygame is not installed.
    """

    def __init__(self, max_steps: int) -> None:
        require_pygame("a picture of a state")
        import pygame

        from robotouille_client.window.drawing.painter import Painter

        self._max_steps = max_steps
        self._painter = Painter()
        self._surface = pygame.Surface(SIZE)

    def data_uri(self, state: State, step: int) -> str:
        """A state after so many steps, as `data:image/jpeg;base64,…`."""
        import pygame

        from robotouille_client.window.view import View

        view = View(state.world, state, step=step, max_steps=self._max_steps)
        self._painter.paint(self._surface, view)
        file = io.BytesIO()
        pygame.image.save(self._surface, file, "state.jpg")
        return f"data:image/jpeg;base64,{base64.b64encode(file.getvalue()).decode()}"
