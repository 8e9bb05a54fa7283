"""Names for bots that were given none, so that people can tell them apart and talk to them."""

from __future__ import annotations

import re

__all__ = ["given_names"]

NAMES = (
    "Ada", "Ben", "Cleo", "Dov", "Edda", "Finn", "Gus", "Hana", "Ivo", "June", "Kai", "Lou",
    "Mika", "Nora", "Otto", "Pia",
)  # fmt: skip
"""Short, given names, easy to tell apart."""


def given_names(seed: int = 0, seat: str | None = None) -> tuple[str, ...]:
    """All names, the one to take first in front: by the seed, and by the seat if one is asked
    for."""
    number = re.search(r"\d+$", seat or "")
    first = (seed + (int(number[0]) - 1 if number else 0)) % len(NAMES)
    return (*NAMES[first:], *NAMES[:first])
