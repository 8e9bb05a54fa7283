"""Fonts for any script: the one that comes with pygame, then those of the system.

Nothing is looked for on the system until a letter needs it. What no font has is written as its
code, so that two names are never the same row of boxes.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby

import pygame

__all__ = ["FontStack", "printable", "system_fonts"]

_FAMILIES = (
    "notosans", "dejavusans", "liberationsans", "freesans", "segoeui", "helveticaneue",
    "notosanscjksc", "notosanscjkjp", "notosanscjkkr", "notosanscjktc", "sourcehansans",
    "wenquanyizenhei", "wenquanyimicrohei", "droidsansfallback", "microsoftyahei", "msgothic",
    "yugothic", "malgungothic", "pingfangsc", "hiraginosans", "applesdgothicneo",
    "notosansarabic", "notosanshebrew", "notosansdevanagari", "notosansthai", "notosansbengali",
    "arialunicodems", "notocoloremoji", "segoeuiemoji", "applecoloremoji", "segoeuisymbol",
    "applesymbols", "symbola", "unifont",
)  # fmt: skip
"""Families that are asked for first, by the names that pygame has for them."""

MAX_OPENED = 80
MAX_LENGTH = 600
_TRIED_AT = 16
_NO_LETTER = "\U0010fffd"
"""A code point for private use, which fonts draw as they draw all that they have not."""


def system_fonts() -> Iterator[str]:
    """The files of fonts of this machine: those that cover much first, each once."""
    seen = set()
    known = pygame.font.get_fonts()
    for name in (*_FAMILIES, *sorted(known)):
        path = pygame.font.match_font(name, bold=True) if name in known else None
        if path is not None and path not in seen:
            seen.add(path)
            yield path


class FontStack:
    """Opens fonts as letters need them, and knows which one has which letter."""

    def __init__(self, find: Callable[[], Iterable[str]] = system_fonts) -> None:
        if not pygame.font.get_init():
            pygame.font.init()
        self._find = find
        self._unopened: Iterator[str] | None = None
        self._paths: list[str | None] = [None]
        self._tried: list[pygame.font.Font] = [pygame.font.Font(None, _TRIED_AT)]
        self._fonts: dict[tuple[int, int], pygame.font.Font] = {}
        self._having: dict[str, int | None] = {}

    def font(self, face: int, size: int) -> pygame.font.Font:
        """A font of the stack at a size in pixels; 0 is the default one."""
        key = (face, size)
        if key not in self._fonts:
            self._fonts[key] = pygame.font.Font(self._paths[face], size)
        return self._fonts[key]

    def runs(self, text: str) -> list[tuple[int, str]]:
        """A text in parts that one font each has, in order."""
        if text.isascii():
            return [(0, text)]
        parts: list[tuple[int, str]] = []
        for letter in text:
            if unicodedata.category(letter).startswith("M"):
                # What is combined with a letter is drawn by that letter's font, or not at all.
                parts += [(parts[-1][0], letter)] if parts and parts[-1][1][0] != "[" else []
            else:
                parts.append(self._written(letter))
        return [
            (face, "".join(letter for _, letter in group))
            for face, group in groupby(parts, key=lambda part: part[0])
        ]

    def _written(self, letter: str) -> tuple[int, str]:
        face = self._face_of(letter)
        return (0, f"[{ord(letter):X}]") if face is None else (face, letter)

    def _face_of(self, letter: str) -> int | None:
        if letter.isascii():
            return 0
        if letter not in self._having:
            self._having[letter] = self._search(letter)
        return self._having[letter]

    def _search(self, letter: str) -> int | None:
        for face, font in enumerate(self._tried):
            if _has(font, letter):
                return face
        while self._open_next():
            if _has(self._tried[-1], letter):
                return len(self._tried) - 1
        return None

    def _open_next(self) -> bool:
        """Open the next font of the system that can be; whether there was one."""
        if self._unopened is None:
            self._unopened = iter(self._find())
        for path in self._unopened:
            if len(self._paths) > MAX_OPENED:
                return False
            try:
                font = pygame.font.Font(path, _TRIED_AT)
            except (pygame.error, OSError):
                continue
            self._paths.append(path)
            self._tried.append(font)
            return True
        return False


def _has(font: pygame.font.Font, letter: str) -> bool:
    """Whether a font draws anything for a letter but what it draws for those that it has not."""
    try:
        return _drawn(font, letter) != _drawn(font, _NO_LETTER)
    except pygame.error:
        return False


def _drawn(font: pygame.font.Font, letter: str) -> tuple[tuple[int, int], bytes]:
    surface = font.render(letter, True, (0, 0, 0))
    return surface.get_size(), pygame.image.tobytes(surface, "RGBA")


def printable(text: str) -> str:
    """A text without control characters, lone surrogates, joiners and excess length."""
    text = text[:MAX_LENGTH]
    if text.isascii() and text.isprintable():
        return text
    shown = []
    for letter in unicodedata.normalize("NFC", text):
        if unicodedata.category(letter) == "Cf" or 0xFE00 <= ord(letter) <= 0xFE0F:
            continue
        shown.append(letter if letter.isprintable() else " ")
    return "".join(shown)
