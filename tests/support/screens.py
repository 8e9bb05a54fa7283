"""Virtual screens with readable pixels, and a check that a window there shows an episode."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pygame
import pytest

from robotouille_client import Game
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.view import SeatView, View

__all__ = ["REAL_INPUT", "SIZE", "Likeness", "Screen", "likeness", "open_screen"]

REAL_INPUT = [
    pytest.mark.browser,
    pytest.mark.process,
    pytest.mark.skipif(
        shutil.which("Xvfb") is None or shutil.which("xdotool") is None,
        reason="needs Xvfb and xdotool",
    ),
]
"""Markers of tests that use the mouse and keyboard of a virtual screen."""
SIZE = (1280, 720)
ALIKE = 12
"""Largest mean difference of a colour channel (of 255) for which two tiles count as equal."""


class Screen:
    """Virtual X display, with its name and the file that contains its pixels."""

    def __init__(self, display: str, pixels: Path) -> None:
        self.display = display
        self._pixels = pixels

    def picture(self) -> pygame.Surface:
        """Return the screen's present picture (X window dump: header, colours, rows of BGRX)."""
        dump = self._pixels.read_bytes()
        header = struct.unpack(">25I", dump[:100])
        start, (width, height), line = header[0] + 12 * header[19], header[4:6], header[12]
        rows = dump[start : start + line * height]
        surface = pygame.image.frombuffer(rows, (line // 4, height), "BGRA").convert(24)
        return surface.subsurface((0, 0, width, height)).copy()


@contextmanager
def open_screen(folder: Path, size: tuple[int, int] = SIZE) -> Iterator[Screen]:
    """Open a virtual screen that stores its pixels in an empty folder."""
    folder.mkdir(parents=True)
    reading, writing = os.pipe()
    shape = f"{size[0]}x{size[1]}x24"
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writing), "-screen", "0", shape, "-fbdir", str(folder),
         "-nolisten", "tcp"],
        pass_fds=[writing], stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(writing)
    try:
        with os.fdopen(reading) as pipe:
            yield Screen(f":{pipe.readline().strip()}", folder / "Xvfb_screen0")
    finally:
        server.terminate()
        server.wait()


@dataclass(frozen=True, slots=True)
class Likeness:
    """Match between a picture and a running episode: the share of kitchen tiles that match, and
    whether the player's tile matches. Overlays, such as that of a lost connection, cover tiles.
    """

    tiles: float
    player: bool

    @property
    def good(self) -> bool:
        return self.tiles >= 0.9 and self.player


def likeness(picture: pygame.Surface, painter: Painter, game: Game, player: str) -> Likeness:
    """Compare a picture of a window with the episode's state."""
    difference = _difference(picture, _painted(painter, game, player))
    place = painter.layout(SIZE, game.world)
    here = painter.stage(game.state).placed[player].tile
    same = {
        (x, y): _mean(difference, place.cell((x, y))) <= ALIKE
        for x in range(place.columns)
        for y in range(place.rows)
    }
    return Likeness(
        sum(same.values()) / len(same),
        same.get((round(here[0]), round(here[1])), False),
    )


def _painted(painter: Painter, game: Game, player: str) -> pygame.Surface:
    surface = pygame.Surface(SIZE, depth=24)
    rate = game.clock.get("step_rate", 0)
    view = View(
        world=game.world, state=game.state, step=game.step, max_steps=game.clock.get("max_steps"),
        clock=f"real time, {rate:g} steps a second", me=player, code=game.code,
        seats=tuple(
            SeatView(s.player, s.name, s.kind, s.present, s.acted, s.rejected)
            for s in game.seats
        ),
    )  # fmt: skip
    painter.paint(surface, view)
    return surface


def _difference(one: pygame.Surface, other: pygame.Surface) -> pygame.Surface:
    more, less = one.copy(), other.copy()
    more.blit(other, (0, 0), special_flags=pygame.BLEND_RGB_SUB)
    less.blit(one, (0, 0), special_flags=pygame.BLEND_RGB_SUB)
    more.blit(less, (0, 0), special_flags=pygame.BLEND_RGB_ADD)
    return more


def _mean(difference: pygame.Surface, box: pygame.Rect) -> float:
    red, green, blue, _ = pygame.transform.average_color(difference, box)
    return max(red, green, blue)
