"""Names of participants: visible characters only, and distinct within an episode."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from unicodedata import normalize

from robotouille.visible_text import has_visible, is_seen

MAX_NAME_LENGTH = 40


def proper_name(name: str) -> str:
    """Return a name as it is shown; empty if no character is visible.

    The name is in NFKC, with single spaces, without invisible characters, and at most 40 long.
    """
    # The usual case, without the look-ups in Unicode's tables.
    if name.isascii() and name.isprintable():
        words = name.split()
    else:
        seen = "".join(filter(is_seen, " ".join(name.split())))
        words = normalize("NFKC", seen).split()
    proper = " ".join(words)[:MAX_NAME_LENGTH].rstrip()
    return proper if has_visible(proper) else ""


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
