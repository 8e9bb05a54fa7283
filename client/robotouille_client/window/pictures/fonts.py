"""Fonts for any script: pygame's own font first, then the fonts of the system.

System fonts are searched only when a letter needs one. Letters that no font has are replaced by
their sound or meaning, if Unicode's name for them has one, or else by their code. Two different
names then never look like the same row of boxes.
"""

from __future__ import annotations

import logging
import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from itertools import groupby

import pygame

_LOG = logging.getLogger(__name__)

# Families to try first, by pygame's names for them.
_FAMILIES = (
    "notosans", "dejavusans", "liberationsans", "freesans", "segoeui", "helveticaneue",
    "notosanscjksc", "notosanscjkjp", "notosanscjkkr", "notosanscjktc", "sourcehansans",
    "wenquanyizenhei", "wenquanyimicrohei", "droidsansfallback", "microsoftyahei", "msgothic",
    "yugothic", "malgungothic", "pingfangsc", "hiraginosans", "applesdgothicneo",
    "notosansarabic", "notosanshebrew", "notosansdevanagari", "notosansthai", "notosansbengali",
    "arialunicodems", "notocoloremoji", "segoeuiemoji", "applecoloremoji", "segoeuisymbol",
    "applesymbols", "symbola", "unifont",
)  # fmt: skip

# Scripts (ISO 15924) with context-dependent letter shapes, by the first word of letter names.
_SCRIPTS = {
    "ARABIC": "Arab", "HEBREW": "Hebr", "SYRIAC": "Syrc", "THAANA": "Thaa", "NKO": "Nkoo",
    "DEVANAGARI": "Deva", "BENGALI": "Beng", "GURMUKHI": "Guru", "GUJARATI": "Gujr",
    "TAMIL": "Taml", "TELUGU": "Telu", "KANNADA": "Knda", "MALAYALAM": "Mlym", "SINHALA": "Sinh",
    "THAI": "Thai", "LAO": "Laoo", "KHMER": "Khmr", "MYANMAR": "Mymr", "TIBETAN": "Tibt",
}  # fmt: skip

_FROM_THE_RIGHT = frozenset({"Arab", "Hebr", "Syrc", "Thaa", "Nkoo"})
_SOUND = re.compile(r"(?:HIRAGANA|KATAKANA) LETTER (?:SMALL )?(\w+)$|HANGUL SYLLABLE (\w+)$")
_REGIONAL_A = 0x1F1E6
# Marks on one letter. No script needs more, and a tower of marks would cover other lines.
MAX_MARKS = 4

# This bounds the search: a machine may have thousands of fonts, none of which has a letter.
MAX_OPENED = 80
MAX_LENGTH = 600
_TRIED_AT = 16
# Private-use code point, drawn as a font draws any letter that it lacks.
_NO_LETTER = "\U0010fffd"


def system_fonts() -> Iterator[str]:
    """Yield the font files of this machine once each, those with many letters first."""
    seen = set()
    known = pygame.font.get_fonts()
    for name in (*_FAMILIES, *sorted(known)):
        path = pygame.font.match_font(name, bold=True) if name in known else None
        if path is not None and path not in seen:
            seen.add(path)
            yield path


class FontStack:
    """Opens fonts as letters need them, and finds the font of each letter."""

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
        """Return a font of the stack at a size in pixels, set up for a script; 0 is the default."""
        key = (face, size, script)
        if key not in self._fonts:
            font = self._fonts[key] = pygame.font.Font(self._paths[face], size)
            if script:
                _shape(font, script)
        return self._fonts[key]

    def has(self, letter: str) -> bool:
        """Return whether some font has a letter."""
        return self._face_of(letter) is not None

    def is_readable(self, letter: str) -> bool:
        """Return whether people can read a letter as drawn: itself, its sound or its meaning."""
        return self.has(letter) or not _described(letter).startswith("[")

    def runs(self, text: str) -> list[tuple[int, str]]:
        """Split a text into parts with one font and one script each."""
        if text.isascii():
            return [(0, text)]
        parts: list[tuple[int, str, str]] = []
        drawn = False
        for letter in text:
            if not unicodedata.category(letter).startswith("M"):
                drawn = self.has(letter)
                parts.append((*self._written(letter), script_of(letter)))
            elif drawn:
                # A combining mark is drawn with its letter's font, or not at all.
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
        """Open the next usable system font. Return whether there was one."""
        if self._unopened is None:
            self._unopened = iter(self._find())
        for path in self._unopened:
            if len(self._paths) > MAX_OPENED:
                return False
            try:
                font = pygame.font.Font(path, _TRIED_AT)
            except (pygame.error, OSError) as error:
                _LOG.info("cannot open font %s: %s", path, error)
                continue
            self._paths.append(path)
            self._tried.append(font)
            return True
        return False


def _has(font: pygame.font.Font, letter: str) -> bool:
    """Return whether a font draws a letter differently from a missing one."""
    try:
        # A font draws all missing letters alike.
        return _drawn(font, letter) != _drawn(font, _NO_LETTER)
    except pygame.error:
        return False


def _drawn(font: pygame.font.Font, letter: str) -> tuple[tuple[int, int], bytes]:
    surface = font.render(letter, True, (0, 0, 0))
    return surface.get_size(), pygame.image.tobytes(surface, "RGBA")


def _shape(font: pygame.font.Font, script: str) -> None:
    """Turn on letter shaping and order for a script, where SDL_ttf supports it."""
    try:
        font.set_script(script)
        if script in _FROM_THE_RIGHT:
            font.set_direction(pygame.DIRECTION_RTL)
    except pygame.error as error:
        _warn_unshaped(script, str(error))


@lru_cache(maxsize=64)
def _warn_unshaped(script: str, why: str) -> None:
    """Log once for each script that its letters are not shaped."""
    _LOG.warning("cannot shape letters of script %s: %s", script, why)


@lru_cache(maxsize=4096)
def script_of(text: str) -> str:
    """Return the first shaped script in a text, or an empty string."""
    for letter in text:
        script = _SCRIPTS.get(unicodedata.name(letter, "").partition(" ")[0], "")
        if script:
            return script
    return ""


def _joined(parts: list[tuple[int, str, str]]) -> list[tuple[int, str, str]]:
    """Join blanks to the right-to-left words around them."""
    joined = list(parts)
    for i in range(1, len(parts) - 1):
        before, (_, letter, script), after = joined[i - 1], parts[i], parts[i + 1]
        around = before[2] in _FROM_THE_RIGHT and (before[0], before[2]) == (after[0], after[2])
        if around and not script and letter == " ":
            joined[i] = (before[0], letter, before[2])
    return joined


def _described(letter: str) -> str:
    """Return the sound, meaning or code of a letter that no font has."""
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
    """Split a text into units that must stay whole: letters with marks, flags, coloured hands."""
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
    """Return whether a letter is the skin colour of the hand or face before it."""
    return 0x1F3FB <= ord(letter) <= 0x1F3FF


def printable(text: str) -> str:
    """Return a text without control characters, lone surrogates, joiners and surplus marks.

    It is cut after `MAX_LENGTH` characters.
    """
    text = text[:MAX_LENGTH]
    if text.isascii() and text.isprintable():
        return text
    # NFC joins letters and marks where it can, so that fonts without combining marks can draw
    # them.
    shown, marks = [], 0
    for letter in unicodedata.normalize("NFC", text):
        category = unicodedata.category(letter)
        marks = marks + 1 if category.startswith("M") else 0
        # Joiners and variation selectors have no picture of their own.
        if category == "Cf" or 0xFE00 <= ord(letter) <= 0xFE0F or marks > MAX_MARKS:
            continue
        shown.append(letter if letter.isprintable() else " ")
    return "".join(shown)
