"""Fonts for any script: the one that comes with pygame, then those of the system.

Nothing is looked for on the system until a letter needs it. What no font has is written in another
way: by its sound or its meaning where Unicode tells that in its name, else as its code, so that two
names are never the same row of boxes.
"""

from __future__ import annotations

import logging
import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from itertools import groupby

import pygame

__all__ = ["FontStack", "clusters", "printable", "script_of", "system_fonts"]

_LOG = logging.getLogger(__name__)

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

_SCRIPTS = {
    "ARABIC": "Arab", "HEBREW": "Hebr", "SYRIAC": "Syrc", "THAANA": "Thaa", "NKO": "Nkoo",
    "DEVANAGARI": "Deva", "BENGALI": "Beng", "GURMUKHI": "Guru", "GUJARATI": "Gujr",
    "TAMIL": "Taml", "TELUGU": "Telu", "KANNADA": "Knda", "MALAYALAM": "Mlym", "SINHALA": "Sinh",
    "THAI": "Thai", "LAO": "Laoo", "KHMER": "Khmr", "MYANMAR": "Mymr", "TIBETAN": "Tibt",
}  # fmt: skip
"""Scripts whose letters take the shape that their neighbours give them, by the first word of their
letters' names (ISO 15924)."""

_FROM_THE_RIGHT = frozenset({"Arab", "Hebr", "Syrc", "Thaa", "Nkoo"})
_SOUND = re.compile(r"(?:HIRAGANA|KATAKANA) LETTER (?:SMALL )?(\w+)$|HANGUL SYLLABLE (\w+)$")
_REGIONAL_A = 0x1F1E6
MAX_MARKS = 4
"""Marks on one letter: no script needs more, and a tower of them would cover other lines."""

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
        self._fonts: dict[tuple[int, int, str], pygame.font.Font] = {}
        self._having: dict[str, int | None] = {}

    def font(self, face: int, size: int, script: str = "") -> pygame.font.Font:
        """A font of the stack at a size in pixels, for letters of a script; 0 is the default."""
        key = (face, size, script)
        if key not in self._fonts:
            font = self._fonts[key] = pygame.font.Font(self._paths[face], size)
            if script:
                _shape(font, script)
        return self._fonts[key]

    def has(self, letter: str) -> bool:
        """Whether a letter is drawn, and not written in another way."""
        return self._face_of(letter) is not None

    def reads(self, letter: str) -> bool:
        """Whether people can read a letter as it is written: itself, its sound or its meaning."""
        return self.has(letter) or not _described(letter).startswith("[")

    def runs(self, text: str) -> list[tuple[int, str]]:
        """A text in parts that have one font and one script each, in order."""
        if text.isascii():
            return [(0, text)]
        parts: list[tuple[int, str, str]] = []
        drawn = False
        for letter in text:
            if not unicodedata.category(letter).startswith("M"):
                drawn = self.has(letter)
                parts.append((*self._written(letter), script_of(letter)))
            elif drawn:
                # What is combined with a letter is drawn by that letter's font, or not at all.
                face, _, script = parts[-1]
                parts.append((face, letter, script))
        return [
            (face, "".join(letter for _, letter, _ in group))
            for (face, _), group in groupby(_joined(parts), key=lambda part: (part[0], part[2]))
        ]

    def _written(self, letter: str) -> tuple[int, str]:
        face = self._face_of(letter)
        return (0, _described(letter)) if face is None else (face, letter)

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
            except (pygame.error, OSError) as error:
                _LOG.info("a font cannot be opened: %s: %s", path, error)
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


def _shape(font: pygame.font.Font, script: str) -> None:
    """Have letters shaped and ordered as their script has it, where SDL_ttf can do that."""
    try:
        font.set_script(script)
        if script in _FROM_THE_RIGHT:
            font.set_direction(pygame.DIRECTION_RTL)
    except pygame.error as error:
        _tell_unshaped(script, str(error))


@lru_cache(maxsize=64)
def _tell_unshaped(script: str, why: str) -> None:
    """Say, once for each script, that its letters stand side by side as they are."""
    _LOG.warning("letters of the script %s are not shaped: %s", script, why)


@lru_cache(maxsize=4096)
def script_of(text: str) -> str:
    """The script of the first letter that has one whose letters are shaped; else nothing."""
    for letter in text:
        script = _SCRIPTS.get(unicodedata.name(letter, "").partition(" ")[0], "")
        if script:
            return script
    return ""


def _joined(parts: list[tuple[int, str, str]]) -> list[tuple[int, str, str]]:
    """Blanks between words that are written from the right belong to them."""
    joined = list(parts)
    for i in range(1, len(parts) - 1):
        before, (_, letter, script), after = joined[i - 1], parts[i], parts[i + 1]
        around = before[2] in _FROM_THE_RIGHT and (before[0], before[2]) == (after[0], after[2])
        if around and not script and letter == " ":
            joined[i] = (before[0], letter, before[2])
    return joined


def _described(letter: str) -> str:
    """A letter that no font has: its sound, its meaning or its code."""
    name = unicodedata.name(letter, "")
    sound = _SOUND.match(name)
    if sound is not None:
        return (sound[1] or sound[2]).lower()
    plain = unicodedata.normalize("NFKC", letter)
    if plain.isascii():
        return plain
    if _is_regional(letter):
        return chr(ord("A") + ord(letter) - _REGIONAL_A)
    if _is_tone(letter):
        return ""
    if unicodedata.category(letter) == "So" and name and len(name) <= 24:
        return f"({name.lower()})"
    return f"[{ord(letter):X}]"


def clusters(text: str) -> list[str]:
    """A text in parts that must not be torn: letters with their marks, flags, coloured hands."""
    found: list[str] = []
    for letter in text:
        pair = found and len(found[-1]) == 1 and _is_regional(found[-1]) and _is_regional(letter)
        if found and (pair or _is_tone(letter) or unicodedata.category(letter).startswith("M")):
            found[-1] += letter
        else:
            found.append(letter)
    return found


def _is_regional(letter: str) -> bool:
    return _REGIONAL_A <= ord(letter) < _REGIONAL_A + 26


def _is_tone(letter: str) -> bool:
    """Whether it is the colour of a hand or face before it."""
    return 0x1F3FB <= ord(letter) <= 0x1F3FF


def printable(text: str) -> str:
    """A text without control characters, lone surrogates, joiners, towers of marks and excess
    length."""
    text = text[:MAX_LENGTH]
    if text.isascii() and text.isprintable():
        return text
    shown, marks = [], 0
    for letter in unicodedata.normalize("NFC", text):
        category = unicodedata.category(letter)
        marks = marks + 1 if category.startswith("M") else 0
        if category == "Cf" or 0xFE00 <= ord(letter) <= 0xFE0F or marks > MAX_MARKS:
            continue
        shown.append(letter if letter.isprintable() else " ")
    return "".join(shown)
