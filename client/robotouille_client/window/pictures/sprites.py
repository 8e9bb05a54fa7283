"""Pictures at any size: SVG files, or generated tiles for kinds without a picture."""

from __future__ import annotations

import re
from concurrent.futures import Future, ThreadPoolExecutor
from io import BytesIO
from pathlib import Path

import pygame

from robotouille.domain.pictures import PictureError, read_picture, sharp_side
from robotouille_client.window.pictures.appearance import Appearance
from robotouille_client.window.pictures.shapes import PictureCache
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import INK, PAPER, Colour, kind_colour, mixed

_FINE = 3
_EYES = {"front": 0.0, "left": -0.1, "right": 0.1}


def generate(appearance: Appearance, size: int, text: Typesetter) -> pygame.Surface:
    """Return a square tile for an object. It is drawn large and shrunk, which smooths its edges."""
    large = pygame.Surface((size * _FINE, size * _FINE), pygame.SRCALPHA)
    colour = kind_colour(appearance.kind)
    if appearance.role == "station":
        _bench(large, colour)
    elif appearance.role == "player":
        _figure(large, colour, appearance.facing)
    else:
        _block(large, colour, round_top=appearance.role == "container")
    tile = pygame.transform.smoothscale(large, (size, size))
    _label(tile, appearance, text)
    return tile


def _box(surface: pygame.Surface, x: float, y: float, w: float, h: float) -> pygame.Rect:
    side = surface.get_width()
    return pygame.Rect(round(x * side), round(y * side), round(w * side), round(h * side))


def _outlined(surface: pygame.Surface, box: pygame.Rect, fill: Colour, radius: float) -> None:
    side = surface.get_width()
    pygame.draw.rect(surface, fill, box, border_radius=round(radius * side))
    pygame.draw.rect(
        surface, INK, box, width=max(1, round(0.03 * side)), border_radius=round(radius * side)
    )


def _bench(surface: pygame.Surface, colour: Colour) -> None:
    front = _box(surface, 0.01, 0.1, 0.98, 0.89)
    _outlined(surface, front, mixed(colour, INK, 0.35), 0.05)
    _outlined(surface, _box(surface, 0.01, 0.01, 0.98, 0.74), mixed(colour, PAPER, 0.25), 0.05)
    shine = _box(surface, 0.07, 0.06, 0.86, 0.05)
    pygame.draw.rect(surface, mixed(colour, PAPER, 0.6), shine, border_radius=shine.height // 2)


def _block(surface: pygame.Surface, colour: Colour, *, round_top: bool) -> None:
    _outlined(surface, _box(surface, 0.08, 0.18, 0.84, 0.68), colour, 0.3 if round_top else 0.14)
    shine = _box(surface, 0.2, 0.26, 0.6, 0.06)
    pygame.draw.rect(surface, mixed(colour, PAPER, 0.6), shine, border_radius=shine.height // 2)


def _figure(surface: pygame.Surface, colour: Colour, facing: str) -> None:
    _outlined(surface, _box(surface, 0.3, 0.5, 0.4, 0.44), mixed(colour, INK, 0.25), 0.14)
    _outlined(surface, _box(surface, 0.24, 0.1, 0.52, 0.5), colour, 0.25)
    if facing == "back":
        return
    shift = _EYES.get(facing, 0.0)
    for x in (0.36, 0.54):
        eye = _box(surface, x + shift, 0.28, 0.1, 0.14)
        pygame.draw.ellipse(surface, PAPER, eye)
        pygame.draw.ellipse(surface, INK, eye.inflate(-eye.width // 2, -eye.height // 2))


def _label(tile: pygame.Surface, appearance: Appearance, text: Typesetter) -> None:
    side = tile.get_width()
    lines = [appearance.kind, *appearance.words.split()[:2]]
    middle = {"station": 0.86, "player": 0.76}.get(appearance.role, 0.52)
    height = max(7, min(13, side // 5 if len(lines) == 1 else side // 6))
    if appearance.role == "station":
        height = max(7, min(height, round(side * 0.2 / len(lines))))
    total = (len(lines) - 1) * height
    for i, line in enumerate(lines):
        size = height
        while size > 7 and text.width(line, size) > side * 0.86:
            size -= 1
        colour = PAPER if appearance.role == "station" else INK
        words = text.line(text.fit(line, size, round(side * 0.96)), size, colour)
        y = side * middle - total / 2 + i * height
        tile.blit(words, words.get_rect(center=(side // 2, round(y))))


SQUASH = 0.05
"""Share by which a squat or stretched picture is wider or narrower."""
# Largest side of a picture in pixels, whatever size a rendering asks for.
MAX_SIDE = 2048

_GRADIENT = re.compile(rb"<(?:\w+:)?(?:linear|radial)Gradient\b[^<>]*>")
# Possessive, so that the time is linear for any picture that a server sends.
_SHARE = re.compile(
    rb"""(\s(?:[xy][12]|[cf][xy]|r)\s*=\s*["']\s*)([+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?+)(?=\s*+["'])"""
)


# Share of `MAX_DRAWN` up to which a received picture is drawn at once: 10 to 25 ms.
_AT_ONCE = 0.04

# A thread starts with its first picture.
drawing_thread = ThreadPoolExecutor(1, thread_name_prefix="pictures")


class Sprites:
    """Pictures from folders, drawn once for each size. The first folder with a file wins.

    A missing or broken file is not an error: the kind gets a generated tile.

    Args:
        received: The folder with pictures from a server. Elaborate ones are drawn in another
            thread, one at a time, because they would delay frames. Until then they are treated as
            missing.
    """

    def __init__(
        self, folders: tuple[Path, ...], text: Typesetter, received: Path | None = None
    ) -> None:
        self._folders = folders
        self._received = received
        self._text = text
        self._kept = PictureCache()
        self._missing: set[str] = set()
        self._sharp: dict[Path, int] = {}
        self._drawing: tuple[str, int, Future[pygame.Surface | None]] | None = None
        self.revision = 0
        """Number of pictures that another thread has drawn: a frame then looks different."""

    @property
    def roomy(self) -> bool:
        """True while pictures can be drawn ahead of need."""
        return self._kept.roomy

    def file(self, name: str | None, size: int) -> pygame.Surface | None:
        """Return a file's picture as a square of `size` pixels, or None."""
        if name is None or size < 1:
            return None
        size = min(size, MAX_SIDE)
        picture = self._kept.get((name, size))
        if picture is None and name not in self._missing:
            path = next((f / name for f in self._folders if (f / name).is_file()), None)
            if path is not None and self._is_elaborate(path, size):
                self._draw_later(path, size)
                return None
            return self._keep(name, size, None if path is None else _load(path, size))
        return picture

    def collect(self) -> int:
        """Take the picture that another thread has finished, if any; return `revision`."""
        if self._drawing is not None and self._drawing[2].done():
            name, size, drawn = self._drawing
            self._drawing = None
            self._keep(name, size, drawn.result())
            self.revision += 1
        return self.revision

    def _keep(self, name: str, size: int, picture: pygame.Surface | None) -> pygame.Surface | None:
        if picture is None:
            # The result is remembered, because looking for a file in every frame would be slow.
            self._missing.add(name)
            return None
        return self._kept.keep((name, size), picture)

    def _is_elaborate(self, path: Path, size: int) -> bool:
        if path.parent != self._received or path.suffix != ".svg":
            return False
        if path not in self._sharp:
            try:
                self._sharp[path] = sharp_side(path.read_bytes())
            except OSError:
                return False
        return size * size > self._sharp[path] * self._sharp[path] * _AT_ONCE

    def _draw_later(self, path: Path, size: int) -> None:
        # Requests are not queued, because the next frame repeats those that are still needed.
        if self._drawing is None:
            self._drawing = (path.name, size, drawing_thread.submit(_load, path, size))

    def faded(self, name: str | None, size: int) -> pygame.Surface | None:
        """Return a file's picture half transparent."""
        return self.shade(name, size, 110)

    def shade(self, name: str | None, size: int, opacity: int) -> pygame.Surface | None:
        """Return a file's picture with an opacity from 0 to 255."""
        picture = self.file(name, size)
        if picture is None or name is None:
            return None
        key = (name, size, opacity)
        faded = self._kept.get(key)
        if faded is None:
            faded = self._kept.keep(key, picture.copy())
            faded.fill((255, 255, 255, opacity), special_flags=pygame.BLEND_RGBA_MULT)
        return faded

    def squashed(self, appearance: Appearance, size: int, squash: int) -> pygame.Surface:
        """Return an object's picture as for `of`: squat for 1, stretched for -1."""
        if not squash:
            return self.of(appearance, size)
        key = (appearance, size, squash)
        made = self._kept.get(key)
        if made is None:
            change = round(SQUASH * squash * size)
            plain = self.of(appearance, size)
            made = pygame.transform.smoothscale(plain, (size + change, size - change))
            self._kept.keep(key, made)
        return made

    def of(self, appearance: Appearance, size: int) -> pygame.Surface:
        """Return the picture of an object as a square of `size` pixels."""
        size = max(1, min(size, MAX_SIDE))
        picture = self.file(appearance.asset, size)
        if picture is not None:
            return picture
        key = (appearance, size)
        made = self._kept.get(key)
        return made or self._kept.keep(key, generate(appearance, size, self._text))


def _load(path: Path, size: int) -> pygame.Surface | None:
    try:
        content = read_picture(path)
        if path.suffix == ".svg":
            side = min(size, sharp_side(content))
            drawing = BytesIO(with_percentages(content))
            loaded = pygame.image.load_sized_svg(drawing, (side, side))
        else:
            loaded = pygame.image.load(BytesIO(content), path.name)
    except (pygame.error, OSError, PictureError):
        return None
    # Blits between surfaces with the same order of colours are twice as fast.
    surface = pygame.Surface((size, size), pygame.SRCALPHA)
    if loaded.get_size() != (size, size):
        standard = pygame.Surface(loaded.get_size(), pygame.SRCALPHA)
        standard.blit(loaded, (0, 0))
        loaded = pygame.transform.smoothscale(standard, (size, size))
    surface.blit(loaded, (0, 0))
    return surface


def with_percentages(svg: bytes) -> bytes:
    """Rewrite the numbers of an SVG's gradients as percentages.

    Gradient coordinates are shares of the shape's box unless `userSpaceOnUse` is set: `1` equals
    `100%` (W3C, SVG 1.1, section 13.2). NanoSVG, which SDL_image uses, reads plain numbers as
    pixels and then shows only the last colour. It reads percentages correctly.
    """
    return _GRADIENT.sub(_rewritten, svg)


def _rewritten(gradient: re.Match[bytes]) -> bytes:
    tag = gradient[0]
    return tag if b"userSpaceOnUse" in tag else _SHARE.sub(_percentage, tag)


def _percentage(share: re.Match[bytes]) -> bytes:
    return share[1] + f"{100 * float(share[2]):.6g}%".encode()
