"""Golden pictures of the window: contact sheets, a scene of each task, events and window sizes.

`python -m tests.support.golden_pictures` draws the changed pictures again, into
`tests/window/golden`. Review them before you commit them.

Tests compare pictures by tile and not by pixel, because versions of pygame smooth edges
differently.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import numpy as np
import pygame
from tools.contact_sheet import sheet

from robotouille import State, Task, World, load_task, task_names
from robotouille.planning.plan import read_plan
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.window_layout import ActionMark, UiOverlay
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import Bubble, FarewellView, PauseView, SeatView, View
from tests.support.viewer_pictures import VIEWER_SIZES, viewer_picture

__all__ = ["GOLDEN", "PICTURES", "TOLERANCE", "difference", "distance", "redraw", "scene"]

GOLDEN = Path(__file__).parents[1] / "window/golden"
SIZE, KEPT, SIDE = (640, 480), 240, 32
"""Size when drawn, width when stored, and side of an object on a contact sheet."""
TILE, TOLERANCE = 12, 14.0
"""Side of a tile in pixels, and the largest allowed difference of its mean colour (of 255)."""

SHEETS = ("asynchronous/10", "examples/pancakes", "workshop/02")
THEMED = ("multi_agent/07", "examples/pancakes", "workshop/02")
"""Tasks that are also drawn with another rendering."""
WINDOWS = ((320, 240), (640, 1000), (1280, 720), (2560, 1440))
"""Window sizes in which one scene is drawn."""


def middle(task: Task) -> tuple[State, State, int]:
    """Return two states in the middle of a task's plan, or the first state without a plan."""
    world = World(task)
    state, name = world.initial, task.name.rpartition("/")[2]
    files = (
        [task.folder / f"{name}{seats}.plan" for seats in (f"@{task.seats}", "")]
        if task.folder
        else []
    )
    plan = next((f for f in files if f.is_file()), None)
    if plan is None:
        return state, state, 0
    steps = list(read_plan(plan.read_text(encoding="utf-8"), world))
    before = state
    for joint in steps[: len(steps) * 2 // 3]:
        before, state = state, state.step(list(joint)).state
    return before, state, len(steps) * 2 // 3


def scene(
    name: str,
    rendering: str = "",
    size: tuple[int, int] = SIZE,
    ui: UiOverlay | None = None,
    *,
    strong: bool = False,
    **seen: Any,
) -> pygame.Surface:
    """Draw a window in the middle of a task; `seen` overrides fields of the view."""
    before, state, step = middle(load_task(name))
    players = state.world.players
    view = View(
        state.world, state, before, step, 100, "real time", 0.6,
        tuple(SeatView(player, player.title(), actions=step) for player in players), players[0],
        (Bubble(players[-1], "I am here.", "chat"),), (("Ada", "Hello."),), step_seconds=0.2,
    )  # fmt: skip
    surface = pygame.Surface(size)
    painter = Painter(rendering, preferences=Preferences(strong_contrast=strong))
    painter.paint(surface, replace(view, **seen), ui)
    width = min(KEPT if size[0] > size[1] else KEPT * 2 // 3, size[0])
    return pygame.transform.smoothscale(surface, (width, width * size[1] // size[0]))


AWAY = SeatView("robot2", "Ben", connected=False, substitute="astar")
FAR = SeatView("robot2", "Ben", latency_ms=350)
KEYS = (("WASD", "walk"), ("Tab", "all actions"), ("H", "help"))
CHOICES = tuple(f"Go to table {number}" for number in range(1, 9))
MOMENTS: dict[str, dict[str, Any]] = {
    "start": {"bubbles": (), "step": 0},
    "countdown": {"starts_in": 2.4, "status": "The game begins"},
    "refusal": {"bubbles": (Bubble("robot1", "The board is not free."),)},
    "blocked": {"blocked": (("robot2", "stove1", "robot1"),)},
    "waited-for": {"waits_for": ("robot2",)},
    "away": {"seats": (SeatView("robot1", "Ada"), AWAY)},
    "far": {"seats": (SeatView("robot1", "Ada"), FAR), "size": (320, 240)},
    "strong": {"seats": (SeatView("robot1", "Ada"), AWAY), "size": (320, 240), "strong": True},
    "paused": {"pause": PauseView("Ben's connection is lost", "It goes on when he is back.", 22)},
    "offline": {"offline": 7.0},
    "farewell": {"farewell": FarewellView("You were sent out", "The operator has done that.")},
    "notice": {"notice": "Five minutes are left.", "code": "RNYHV-KDQTA"},
    "signal": {"bubbles": (Bubble("robot1", "I need", "chat", ("stove1",), "stove1"),
                           Bubble("robot2", "", "chat", ("table2", "lettuce1")))},
    "won": {"outcome": "You have made the soup.", "won": True},
    "lost": {"outcome": "Out of steps.", "lost": True},
    "spectator": {"me": None, "watching": 3},
    "hover": {"hover": "table2", "ui": UiOverlay((200, 200), ("Take the onion",), keys=KEYS)},
    "ticket": {"ui": UiOverlay((540, 120))},
    "hands": {
        "ui": UiOverlay(
            prompt="Nothing to do here", keys=KEYS, choices=CHOICES, chosen=2, more="9 more",
            marks=(ActionMark("stove1", "rejected"),),
        )
    },
    "typing": {"ui": UiOverlay(typing="I shall take the pot")},
    "help": {"ui": UiOverlay(help=(*KEYS, ("F11", "fill the screen")))},
}  # fmt: skip
"""Events in an episode, each with the fields of its view."""


def _sheet(name: str, rendering: str = "") -> pygame.Surface:
    return sheet(load_task(name), SIDE, 0, rendering)


PICTURES: dict[str, Callable[[], pygame.Surface]] = {
    **{f"viewer-{size[0]}x{size[1]}": partial(viewer_picture, size) for size in VIEWER_SIZES},
    "sheet-chalk": partial(_sheet, "asynchronous/10", "chalk"),
    **{f"{name.replace('/', '-')}-chalk": partial(scene, name, "chalk") for name in THEMED},
    **{f"sheet-{name.replace('/', '-')}": partial(_sheet, name) for name in SHEETS},
    **{
        f"moment-{moment}": partial(scene, "multi_agent/07@2", **seen)
        for moment, seen in MOMENTS.items()
    },
    **{
        f"window-{size[0]}x{size[1]}": partial(scene, "multi_agent/10@4", size=size)
        for size in WINDOWS
    },
    **{
        name.replace("/", "-"): partial(scene, name)
        for name in task_names()
        if not name.startswith("generated/")
    },
}


def difference(one: pygame.Surface, other: pygame.Surface) -> float:
    """Return the largest difference of a tile's mean colours, or 255 for another size."""
    if one.get_size() != other.get_size():
        return 255.0
    means = []
    for surface in (one, other):
        pixels = pygame.surfarray.array3d(surface).astype(np.float64)
        width, height = (side - side % TILE for side in surface.get_size())
        tiles = pixels[:width, :height].reshape(width // TILE, TILE, height // TILE, TILE, 3)
        means.append(tiles.mean(axis=(1, 3)))
    return float(np.abs(means[0] - means[1]).max())


def redraw(folder: Path, pictures: Mapping[str, Callable[[], pygame.Surface]]) -> None:
    """Draw the changed pictures again, and delete unused ones."""
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.jpg"):
        if old.stem not in pictures:
            old.unlink()
    changed = [name for name, draw in pictures.items() if _changed(folder / f"{name}.jpg", draw())]
    print(f"{len(changed)} of {len(pictures)} pictures in {folder.name} have changed", *changed)


def distance(golden: Path, now: pygame.Surface) -> float:
    """Return the difference from a golden picture, after the same compression."""
    return difference(pygame.image.load(golden), _as_kept(now, golden.name)[1])


def _changed(path: Path, now: pygame.Surface) -> bool:
    """Write a picture unless it equals the stored one; return whether it was written."""
    content, kept = _as_kept(now, path.name)
    if path.is_file() and difference(pygame.image.load(path), kept) < TOLERANCE / 3:
        return False
    path.write_bytes(content)
    return True


def _as_kept(picture: pygame.Surface, name: str) -> tuple[bytes, pygame.Surface]:
    """Return a picture's file content, and the picture as that file shows it."""
    content = BytesIO()
    pygame.image.save(picture, content, name)
    return content.getvalue(), pygame.image.load(BytesIO(content.getvalue()), name)


if __name__ == "__main__":
    redraw(GOLDEN, PICTURES)
