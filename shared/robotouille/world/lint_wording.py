"""Check of a kitchen's words for characters that nobody can see.

Invisible characters can change the order of words, or make two names look alike.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from unicodedata import name

from robotouille.errors import Fault, bounded
from robotouille.visible_text import invisible_in

_DIRECTION_MARKS = dict.fromkeys((0x061C, 0x200E, 0x200F))


@bounded
def lint_wording(raw: Any) -> list[Fault]:
    """Report every text of a JSON value that has an invisible character.

    Line feeds and the marks that languages need to state their direction are permitted.
    """
    return [
        Fault(place, f"has the invisible character {_named(letter)}: remove it")
        for place, text in _texts(raw, "")
        if (letter := invisible_in(text.translate(_DIRECTION_MARKS)))
    ]


def _texts(raw: Any, place: str) -> Iterator[tuple[str, str]]:
    """Yield each text with its place, also the names of fields."""
    if isinstance(raw, str):
        yield place, raw
    elif isinstance(raw, list):
        for i, value in enumerate(raw):
            yield from _texts(value, f"{place}[{i}]")
    elif isinstance(raw, dict):
        for key, value in raw.items():
            yield place, key
            yield from _texts(value, f"{place}.{key}" if place else key)


def _named(letter: str) -> str:
    return f"U+{ord(letter):04X} {name(letter, '')}".strip()
