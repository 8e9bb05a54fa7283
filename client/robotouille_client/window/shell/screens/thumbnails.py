"""Small pictures of kitchens, for menus; drawn when there is time, and kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

import pygame

from robotouille.domain.loading import load_task
from robotouille.domain.task import Task
from robotouille.errors import RobotouilleError
from robotouille.world.world import State, World
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.view import SeatView, View

__all__ = ["Thumbnails"]

SIZE = (640, 400)
MAX_KEPT = 64
_Key = tuple[str, str]

_kitchens: OrderedDict[_Key, pygame.Surface | None] = OrderedDict()
"""Each kitchen as it was drawn, by its name and rendering."""


class Thumbnails:
    """Pictures of kitchens as they begin, in one rendering.

    What is not drawn yet is drawn by `load`, one picture at a time, the one that was asked for last
    first.
    """

    def __init__(self, rendering: str = "") -> None:
        self._rendering = rendering
        self._wanted: dict[str, tuple[Callable[[], Task], Callable[[State], str] | None]] = {}
        self._scaled: dict[tuple[str, tuple[int, int]], pygame.Surface] = {}

    def at(
        self,
        name: str,
        room: tuple[int, int],
        task: Callable[[], Task] | None = None,
        you: Callable[[State], str] | None = None,
    ) -> pygame.Surface | None:
        """A kitchen that fits into a size; None while it is not drawn, and where it cannot be.

        Args:
            name: That of a shipped task, or any other that says which one it is.
            task: What loads it; `load_task` if None.
            you: Tells which player is marked, if one is.
        """
        key = (name, self._rendering)
        if key not in _kitchens:
            self._wanted.pop(name, None)
            self._wanted[name] = (task or (lambda: load_task(name)), you)
            return None
        _kitchens.move_to_end(key)
        kitchen = _kitchens[key]
        if kitchen is None:
            return None
        if (name, room) not in self._scaled:
            if len(self._scaled) >= 2 * MAX_KEPT:
                self._scaled.clear()
            scale = min(most / side for most, side in zip(room, kitchen.get_size(), strict=True))
            width, height = (max(1, round(side * scale)) for side in kitchen.get_size())
            self._scaled[name, room] = pygame.transform.smoothscale(kitchen, (width, height))
        return self._scaled[name, room]

    def load(self) -> bool:
        """Draw one that was asked for; whether there was any."""
        if not self._wanted:
            return False
        name, (task, you) = self._wanted.popitem()
        while len(_kitchens) >= MAX_KEPT:
            _kitchens.popitem(last=False)
        _kitchens[name, self._rendering] = _drawn(task, you, self._rendering)
        return True


def _drawn(
    load: Callable[[], Task], you: Callable[[State], str] | None, rendering: str
) -> pygame.Surface | None:
    try:
        world = World(load())
        painter = Painter(rendering)
        whole = pygame.Surface(SIZE)
        me = None if you is None else you(world.initial)
        seats = () if me is None else (SeatView(me, "you"),)
        painter.paint(whole, View(world, world.initial, me=me, seats=seats))
    except (RobotouilleError, OSError, ValueError, pygame.error):
        return None
    kitchen = painter.layout(whole.get_size(), world).kitchen.clip(whole.get_rect())
    return whole.subsurface(kitchen).copy()
