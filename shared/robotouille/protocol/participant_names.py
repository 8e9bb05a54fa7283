"""What participants may be called: no name holds what cannot be seen, and none is twice there."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from unicodedata import category, normalize

__all__ = ["MAX_NAME_LENGTH", "distinct_name", "likeness", "proper_name"]

MAX_NAME_LENGTH = 40

_UNSEEN = frozenset(
    chr(point)
    for points in (
        # What Unicode calls default ignorable, and is no control or format character.
        (0x034F, 0x115F, 0x1160, 0x17B4, 0x17B5, 0x3164, 0xFFA0),
        range(0x180B, 0x1810),
        range(0xFE00, 0xFE10),
        range(0xE0100, 0xE01F0),
        # What is blank all the same: in Braille, music, Khitan, hieroglyphs, for an object.
        (0x2800, 0x1D159, 0x16FE4, 0x13441, 0x13442, 0xFFFC),
        # What only says how its neighbours are joined: in Tifinagh, Brahmi, Zanabazar, Soyombo.
        (0x2D7F, 0x1107F, 0x11A47, 0x11A99),
    )
    for point in points
)
"""Letters, marks and symbols that nobody sees: fillers, joiners, blanks, selectors of a variant."""


def proper_name(name: str) -> str:
    """A name as it is shown: NFKC, without control characters, marks of direction and what else
    cannot be seen, each white space as one blank, at most 40 characters. Empty where nothing of
    it can be seen."""
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
    """Two names with the same likeness are the same for people: letter case does not count."""
    return normalize("NFKC", name.casefold()).casefold()


def distinct_name(name: str, is_taken: Callable[[str], bool], first: int = 2) -> str:
    """A proper name, with the first number from `first` on that makes it unlike all that are
    taken; `is_taken` is asked for likenesses."""
    numbered = name
    for number in count(first):
        if not is_taken(likeness(numbered)):
            break
        ending = f" {number}"
        numbered = f"{name[: MAX_NAME_LENGTH - len(ending)].rstrip()}{ending}"
    return numbered
