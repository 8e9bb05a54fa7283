"""Pictures at any size: SVG files, or tiles made up for kinds that have no picture."""

from __future__ import annotations

import re
from io import BytesIO
from pathlib import Path

import pygame

from robotouille_client.window.pictures.appearance import Appearance
from robotouille_client.window.pictures.generated_tiles import generate
from robotouille_client.window.pictures.kept import Kept
from robotouille_client.window.pictures.text_surfaces import Typesetter

__all__ = ["Sprites", "with_percentages"]

MAX_SIDE = 2048
"""Of a picture in pixels, whatever size a rendering asks for."""

_GRADIENT = re.compile(rb"<(?:\w+:)?(?:linear|radial)Gradient\b[^<>]*>")
_SHARE = re.compile(
    rb"""(\s(?:[xy][12]|[cf][xy]|r)\s*=\s*["']\s*)([+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?+)(?=\s*+["'])"""
)
"""Possessive: linear on any picture that a server sends."""


class Sprites:
    """The pictures of some folders, the first that has one wins, drawn once for each size.

    A file that is missing or is no picture is not an error: the kind gets a made-up tile.
    """

    def __init__(self, folders: tuple[Path, ...], text: Typesetter) -> None:
        self._folders = folders
        self._text = text
        self._kept = Kept()
        self._missing: set[str] = set()

    @property
    def roomy(self) -> bool:
        """Whether pictures may be drawn that nobody needs yet."""
        return self._kept.roomy

    def file(self, name: str | None, size: int) -> pygame.Surface | None:
        """A picture of the folders as a square of `size` pixels, if there is one."""
        if name is None or size < 1:
            return None
        size = min(size, MAX_SIDE)
        picture = self._kept.get((name, size))
        if picture is None and name not in self._missing:
            picture = self._load(name, size)
            if picture is None:
                self._missing.add(name)
            else:
                self._kept.keep((name, size), picture)
        return picture

    def faded(self, name: str | None, size: int) -> pygame.Surface | None:
        """The same, half transparent."""
        return self.shade(name, size, 110)

    def shade(self, name: str | None, size: int, opacity: int) -> pygame.Surface | None:
        """The same, with an opacity from 0 to 255."""
        picture = self.file(name, size)
        if picture is None or name is None:
            return None
        key = (name, size, opacity)
        faded = self._kept.get(key)
        if faded is None:
            faded = self._kept.keep(key, picture.copy())
            faded.fill((255, 255, 255, opacity), special_flags=pygame.BLEND_RGBA_MULT)
        return faded

    def of(self, appearance: Appearance, size: int) -> pygame.Surface:
        """The picture of a thing as a square of `size` pixels."""
        size = max(1, min(size, MAX_SIDE))
        picture = self.file(appearance.asset, size)
        if picture is not None:
            return picture
        key = (appearance, size)
        made = self._kept.get(key)
        return made or self._kept.keep(key, generate(appearance, size, self._text))

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


def with_percentages(svg: bytes) -> bytes:
    """The same SVG picture, with shares of a box as percentages in its gradients.

    Coordinates of a gradient are shares of the shape's box, unless it says `userSpaceOnUse`: `1`
    and `100%` are the same (W3C, Scalable Vector Graphics 1.1, section 13.2). NanoSVG, with which
    SDL_image draws, takes a plain number for one of pixels, and so shows the last colour alone;
    percentages it understands.
    """
    return _GRADIENT.sub(_rewritten, svg)


def _rewritten(gradient: re.Match[bytes]) -> bytes:
    tag = gradient[0]
    return tag if b"userSpaceOnUse" in tag else _SHARE.sub(_percentage, tag)


def _percentage(share: re.Match[bytes]) -> bytes:
    return share[1] + f"{100 * float(share[2]):.6g}%".encode()
