"""Names of participants: visible characters only, and distinct within an episode."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from unicodedata import category, normalize

MAX_NAME_LENGTH = 40

_UNSEEN = frozenset(
    chr(point)
    for points in (
        # Default ignorable in Unicode, but neither control nor format characters.
        (0x034F, 0x115F, 0x1160, 0x17B4, 0x17B5, 0x3164, 0xFFA0),
        range(0x180B, 0x1810),
        range(0xFE00, 0xFE10),
        range(0xE0100, 0xE01F0),
        # Blank characters: Braille, music, Khitan, hieroglyphs, object replacement.
        (0x2800, 0x1D159, 0x16FE4, 0x13441, 0x13442, 0xFFFC),
        # Joiners of their neighbours: Tifinagh, Brahmi, Zanabazar, Soyombo.
        (0x2D7F, 0x1107F, 0x11A47, 0x11A99),
    )
    for point in points
)
"""Invisible letters, marks and symbols: fillers, joiners, blanks, variation selectors."""


def proper_name(name: str) -> str:
    """Return a name as it is shown; empty if no character is visible.

    The name is in NFKC, with single spaces, without invisible characters, and at most 40 long.
    """
    # The usual case, without the look-ups in Unicode's tables.
    if name.isascii() and name.isprintable():
        words = name.split()
    else:
        seen = "".join(filter(_is_seen, " ".join(name.split())))
        words = normalize("NFKC", seen).split()
    proper = " ".join(words)[:MAX_NAME_LENGTH].rstrip()
    return proper if any(category(letter)[0] not in "MZ" for letter in proper) else ""


def _is_seen(letter: str) -> bool:
    return letter == " " or (category(letter)[0] != "C" and letter not in _UNSEEN)


def likeness(name: str) -> str:
    """Return a key that is equal for names that differ only in letter case."""
    # Folded twice: NFKC can produce capital letters, such as those of mathematical alphabets.
    return normalize("NFKC", name.casefold()).casefold()


def distinct_name(name: str, is_taken: Callable[[str], bool], first: int = 2) -> str:
    """Return a name, with the first number from `first` that makes it distinct if it is taken.

    Args:
        is_taken: Returns whether a `likeness` is in use.
    """
    numbered = name
    for number in count(first):
        if not is_taken(likeness(numbered)):
            break
        ending = f" {number}"
        numbered = f"{name[: MAX_NAME_LENGTH - len(ending)].rstrip()}{ending}"
    return numbered
