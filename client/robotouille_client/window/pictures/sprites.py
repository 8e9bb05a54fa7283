"""Pictures at any size: SVG files, or tiles made up for kinds that have no picture."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import pygame

from robotouille_client.window.pictures.appearance import Appearance
from robotouille_client.window.pictures.generated_tiles import generate
from robotouille_client.window.pictures.svg_gradients import with_percentages
from robotouille_client.window.pictures.text_surfaces import Typesetter

__all__ = ["Sprites"]

_KEPT = 600
MAX_PIXELS = 32_000_000
"""Of all pictures that are kept (128 MiB), whatever sizes a rendering asks for."""
MAX_SIDE = 2048


class Sprites:
    """The pictures of some folders, the first that has one wins, drawn once for each size.

    A file that is missing or is no picture is not an error: the kind gets a made-up tile.
    """

    def __init__(self, folders: tuple[Path, ...], text: Typesetter) -> None:
        self._folders = folders
        self._text = text
        self._files: dict[tuple[str, int], pygame.Surface | None] = {}
        self._made: dict[tuple[Appearance, int], pygame.Surface] = {}
        self._faded: dict[tuple[str, int, int], pygame.Surface] = {}
        self._pixels = 0

    def file(self, name: str | None, size: int) -> pygame.Surface | None:
        """A picture of the folders as a square of `size` pixels, if there is one."""
        if name is None or size < 1:
            return None
        size = min(size, MAX_SIDE)
        key = (name, size)
        if key not in self._files:
            self._make_room(size)
            self._files[key] = self._load(name, size)
        return self._files[key]

    def faded(self, name: str | None, size: int) -> pygame.Surface | None:
        """The same, half transparent."""
        return self.shade(name, size, 110)

    def shade(self, name: str | None, size: int, opacity: int) -> pygame.Surface | None:
        """The same, with an opacity from 0 to 255."""
        picture = self.file(name, size)
        if picture is None or name is None:
            return None
        key = (name, size, opacity)
        if key not in self._faded:
            self._make_room(size)
            copy = picture.copy()
            copy.fill((255, 255, 255, opacity), special_flags=pygame.BLEND_RGBA_MULT)
            self._faded[key] = copy
        return self._faded[key]

    def of(self, appearance: Appearance, size: int) -> pygame.Surface:
        """The picture of a thing as a square of `size` pixels."""
        size = max(1, min(size, MAX_SIDE))
        picture = self.file(appearance.asset, size)
        if picture is not None:
            return picture
        key = (appearance, size)
        if key not in self._made:
            self._make_room(size)
            self._made[key] = generate(appearance, size, self._text)
        return self._made[key]

    def _make_room(self, size: int) -> None:
        """Forget all pictures before another one is too much."""
        self._pixels += size * size
        kept = len(self._files) + len(self._made) + len(self._faded)
        if self._pixels > MAX_PIXELS or kept >= 3 * _KEPT:
            for pictures in (self._files, self._made, self._faded):
                pictures.clear()
            self._pixels = size * size

    def _load(self, name: str, size: int) -> pygame.Surface | None:
        path = next((f / name for f in self._folders if (f / name).is_file()), None)
        if path is None:
            return None
        try:
            if path.suffix == ".svg":
                drawing = BytesIO(with_percentages(path.read_bytes()))
                loaded = pygame.image.load_sized_svg(drawing, (size, size))
            else:
                loaded = pygame.image.load(path)
        except (pygame.error, OSError):
            return None
        # Drawing is twice as fast between surfaces with the same order of colours.
        surface = pygame.Surface((size, size), pygame.SRCALPHA)
        if loaded.get_size() != (size, size):
            standard = pygame.Surface(loaded.get_size(), pygame.SRCALPHA)
            standard.blit(loaded, (0, 0))
            loaded = pygame.transform.smoothscale(standard, (size, size))
        surface.blit(loaded, (0, 0))
        return surface
