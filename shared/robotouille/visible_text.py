"""Visible characters of texts from other people, which people and models must see alike."""

from __future__ import annotations

import re
from itertools import zip_longest
from unicodedata import category

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

_JOINERS, _SELECTORS = "\u200c\u200d", "\ufe0e\ufe0f"
_JOINING = frozenset(_JOINERS + _SELECTORS)
_BASE = rf"[^\x00-\x7f{_JOINERS}{_SELECTORS}]"
# Persian, Indic scripts and emoji need a joiner between two characters, emoji also a selector after
# one, and keycaps a selector after a digit. Everywhere else, both can only hide a text.
_JOINED = re.compile(
    rf"({_BASE}[{_SELECTORS}]?[{_JOINERS}](?={_BASE})"
    rf"|{_BASE}[{_SELECTORS}]"
    r"|[0-9#*]\ufe0f(?=\u20e3))"
    rf"|[{_JOINERS}{_SELECTORS}]"
)


def is_seen(letter: str) -> bool:
    """Return whether a character is visible, or a space."""
    return letter == " " or (category(letter)[0] != "C" and letter not in _UNSEEN)


def has_visible(text: str) -> bool:
    """Return whether a text of visible characters has more than spaces and marks."""
    return any(category(letter)[0] not in "MZ" for letter in text)


def without_invisible(text: str, kept: str = "") -> str:
    """Return a text without invisible characters.

    Joiners and variation selectors are kept where emoji and scripts need them.

    Args:
        kept: Other invisible characters that are kept.
    """
    if text.isprintable() and (text.isascii() or _UNSEEN.isdisjoint(text)):
        return text
    # Each character is looked up once, because the look-ups in Unicode's tables take longest.
    hidden = [letter for letter in set(text).difference(kept) if not _may_stay(letter)]
    shown = text.translate(dict.fromkeys(map(ord, hidden)))
    return shown if _JOINING.isdisjoint(shown) else _JOINED.sub(r"\1", shown)


def plain_text(text: str) -> str:
    """Return a text without invisible characters except tabs and line feeds."""
    return without_invisible(text, kept="\t\n")


def invisible_in(text: str) -> str:
    """Return the first character that `plain_text` removes, or an empty text."""
    shown = plain_text(text)
    pairs = zip_longest(text, shown) if shown != text else ()
    return next((one for one, other in pairs if one != other), "") or ""


def visible_text(text: str) -> str:
    """Return a text without invisible characters; empty if no character is visible."""
    shown = without_invisible(text)
    return shown if has_visible(shown) else ""


def _may_stay(letter: str) -> bool:
    # The usual case, without Unicode's tables.
    if letter.isprintable() and letter not in _UNSEEN:
        return True
    # Python's tables lack the newest emoji; Unicode reserves these places for them.
    emoji = "\U0001f000" <= letter <= "\U0001faff"
    return emoji or letter in _JOINERS or letter in _SELECTORS or is_seen(letter)
