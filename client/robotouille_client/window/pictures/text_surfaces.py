"""Text surfaces, wrapped and cached. Any string is safe to draw."""

from __future__ import annotations

import math

import pygame

from robotouille_client.window.pictures.fonts import (
    FontStack,
    clusters,
    printable,
    script_of,
)
from robotouille_client.window.pictures.shapes import PictureCache
from robotouille_client.window.pictures.theme import Colour, strong_ground, strong_ink

_FINE = 3
_MAX_KEPT = 800


class Typesetter:
    """Draws and caches text, in pygame's default font or in the first font that has a letter.

    With `strong` contrast, inks are lighter or darker.
    """

    def __init__(self, fonts: FontStack | None = None, *, strong: bool = False) -> None:
        self.strong = strong
        self._fonts = fonts or FontStack()
        self._lines = PictureCache()
        self._widths: dict[tuple[str, int], int] = {}
        self._wrapped: dict[tuple[str, int, int, int], tuple[str, ...]] = {}

    def line(self, text: str, size: int, colour: Colour) -> pygame.Surface:
        """Return one line of text. The surface is shared: do not draw on it."""
        ink = strong_ink(colour) if self.strong else colour
        key = (text, size, ink)
        surface = self._lines.get(key)
        if surface is None:
            surface = self._lines.keep(key, self._render(printable(text), size, ink))
        return surface

    def ground(self, colour: Colour) -> Colour:
        """Return a ground for PAPER letters, darker under strong contrast."""
        return strong_ground(colour) if self.strong else colour

    def width(self, text: str, size: int) -> int:
        """Return the width of a line."""
        key = (text, size)
        width = self._widths.get(key)
        if width is None:
            if len(self._widths) >= _MAX_KEPT:
                self._widths.clear()
            runs = self._fonts.runs(printable(text))
            wide = sum(self._run_size(face, part, size)[0] for face, part in runs)
            width = self._widths[key] = math.ceil(wide / _FINE)
        return width

    def is_readable(self, text: str) -> bool:
        """Return whether people can read most letters of a text as drawn."""
        letters = [each for each in printable(text) if not each.isspace()]
        return 2 * sum(self._fonts.is_readable(each) for each in letters) > len(letters)

    def height(self, size: int) -> int:
        """Return the distance between two lines."""
        return self._fonts.font(0, _large(size)).get_linesize() // _FINE + max(1, size // 8)

    def wrap(self, text: str, size: int, width: int, most: int = 0) -> tuple[str, ...]:
        """Wrap a text to `width` pixels; after `most` lines it is cut off with an ellipsis."""
        key = (text, size, width, most)
        lines = self._wrapped.get(key)
        if lines is None:
            if len(self._wrapped) >= _MAX_KEPT:
                self._wrapped.clear()
            lines = self._wrapped[key] = tuple(self._wrap(printable(text), size, width, most))
        return lines

    def wrap_evenly(self, text: str, size: int, width: int, most: int = 0) -> tuple[str, ...]:
        """Wrap a text to the same number of lines as `wrap`, with lines of about equal length."""
        lines = self.wrap(text, size, width, most)
        # The narrowest width that needs no further line makes the lines most even.
        for eighths in range(4, 8) if len(lines) > 1 else ():
            even = self.wrap(text, size, width * eighths // 8, most)
            if len(even) == len(lines) and " ".join(even) == " ".join(lines):
                return even
        return lines

    def fit(self, text: str, size: int, width: int) -> str:
        """Return a text, cut off with an ellipsis if it is wider than `width`."""
        lines = self.wrap(text, size, width, 1)
        return lines[0] if lines else ""

    def _run_size(self, face: int, part: str, size: int) -> tuple[float, float]:
        """Return the enlarged size of letters in one font; fonts of a fixed size are scaled."""
        line = self._fonts.font(0, _large(size)).get_height()
        width, height = self._fonts.font(face, _large(size), script_of(part)).size(part)
        # Colour emoji fonts come in one large size only.
        scale = line / height if height > line * 1.6 else 1.0
        return width * scale, height * scale

    def _render(self, text: str, size: int, colour: Colour) -> pygame.Surface:
        """Draw text large and shrink it: small fonts round the distances between letters."""
        first = self._fonts.font(0, _large(size))
        base, runs = first.get_ascent(), self._fonts.runs(text)
        sizes = [self._run_size(face, part, size) for face, part in runs]
        width, height = sum(wide for wide, _ in sizes), first.get_height()
        small = (max(1, math.ceil(width / _FINE)), max(1, math.ceil(height / _FINE)))
        canvas = pygame.Surface((small[0] * _FINE, small[1] * _FINE), pygame.SRCALPHA)
        canvas.fill((*colour, 0))
        x = 0.0
        for (face, part), (wide, high) in zip(runs, sizes, strict=True):
            font = self._fonts.font(face, _large(size), script_of(part))
            letters = font.render(part, True, colour)
            y = base - font.get_ascent()
            if letters.get_height() > high * 1.01:
                letters = pygame.transform.smoothscale(letters, (round(wide), round(high)))
                y = 0
            canvas.blit(letters, (round(x), y))
            x += wide
        return pygame.transform.smoothscale(canvas, small)

    def _wrap(self, text: str, size: int, width: int, most: int) -> list[str]:
        lines: list[str] = []
        current = ""
        for word in text.split():
            longer = f"{current} {word}" if current else word
            if self.width(longer, size) <= width:
                current = longer
                continue
            if current:
                lines.append(current)
            *whole, current = self._chop(word, size, width)
            lines += whole
        lines += [current] if current else []
        if most and len(lines) > most:
            lines = [*lines[: most - 1], self._shorten(" ".join(lines[most - 1 :]), size, width)]
        return lines

    def _chop(self, word: str, size: int, width: int) -> list[str]:
        """Split a word into pieces of at most a width, without tearing letters from their marks."""
        pieces, left = [], clusters(word)
        while len(left) > 1 and self.width("".join(left), size) > width:
            count = self._fitting(left, size, width)
            pieces.append("".join(left[:count]))
            left = left[count:]
        return [*pieces, "".join(left)]

    def _fitting(self, letters: list[str], size: int, width: int, end: str = "") -> int:
        """Return how many letters fit with an end, at least one."""
        low, high = 1, len(letters)
        while low < high:
            middle = (low + high + 1) // 2
            fits = self.width("".join(letters[:middle]) + end, size) <= width
            low, high = (middle, high) if fits else (low, middle - 1)
        return low

    def _shorten(self, text: str, size: int, width: int) -> str:
        letters = clusters(text)
        if not letters or self.width(text + "…", size) <= width:
            return text.rstrip() + "…"
        count = self._fitting(letters, size, width, "…")
        if self.width("".join(letters[:count]) + "…", size) > width:
            count = 0
        return "".join(letters[:count]).rstrip() + "…"


def _large(size: int) -> int:
    """Return the enlarged font size for letters about `size` pixels high."""
    return max(6, round(size * 1.28)) * _FINE
