"""Small pictures of kitchens for menus, drawn while the player does nothing."""

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

SIZE = (640, 400)
MAX_KEPT = 64
_Key = tuple[str, str]

_kitchens: OrderedDict[_Key, pygame.Surface | None] = OrderedDict()
"""Cache of drawn kitchens by name and rendering."""


class Thumbnails:
    """Pictures of initial states in one rendering.

    Missing pictures are drawn by `load`, one at a time: urgent ones first, and of these the last
    requested.
    """

    def __init__(self, rendering: str = "") -> None:
        self._rendering = rendering
        self._wanted: dict[str, tuple[Callable[[], Task], Callable[[State], str] | None]] = {}
        self._urgent: set[str] = set()
        self._scaled: dict[tuple[str, tuple[int, int]], pygame.Surface] = {}

    def at(
        self,
        name: str,
        room: tuple[int, int],
        task: Callable[[], Task] | None = None,
        you: Callable[[State], str] | None = None,
        *,
        urgent: bool = False,
    ) -> pygame.Surface | None:
        """Return a picture of a kitchen that fits a size; None until it is drawn.

        Args:
            name: Name of a shipped task, or another unique name.
            task: Function that loads the task; None for `load_task`.
            you: Function that returns the player to mark.
            urgent: True if the player misses the picture most.
        """
        key = (name, self._rendering)
        if key not in _kitchens:
            # Reinserting moves the name to the end, so what is visible now is drawn first.
            self._wanted.pop(name, None)
            self._wanted[name] = (task or (lambda: load_task(name)), you)
            if urgent:
                self._urgent.add(name)
            return None
        _kitchens.move_to_end(key)
        kitchen = _kitchens[key]
        if kitchen is None:
            return None
        if (name, room) not in self._scaled:
            # Resizing the window asks for pictures of many sizes that are used only once.
            if len(self._scaled) >= 2 * MAX_KEPT:
                self._scaled.clear()
            scale = min(most / side for most, side in zip(room, kitchen.get_size(), strict=True))
            width, height = (max(1, round(side * scale)) for side in kitchen.get_size())
            self._scaled[name, room] = pygame.transform.smoothscale(kitchen, (width, height))
        return self._scaled[name, room]

    def load(self) -> bool:
        """Draw one requested picture; return whether there was any."""
        if not self._wanted:
            return False
        latest = list(reversed(self._wanted))
        name = next((each for each in latest if each in self._urgent), latest[0])
        task, you = self._wanted.pop(name)
        self._urgent.discard(name)
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
    # Recorded tasks come from elsewhere. A task that cannot be drawn has no picture in the list.
    except (RobotouilleError, OSError, ValueError, pygame.error):
        return None
    kitchen = painter.layout(whole.get_size(), world).kitchen.clip(whole.get_rect())
    return whole.subsurface(kitchen).copy()
