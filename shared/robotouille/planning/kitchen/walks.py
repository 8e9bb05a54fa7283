"""The walks before an action."""

from __future__ import annotations

from robotouille.planning.kitchen.compiled import Ints, kernel
from robotouille.planning.kitchen.layout import (
    HELD,
    LOOSE,
    PLACE,
    PLAYERS,
)
from robotouille.planning.kitchen.moves import pile_place
from robotouille.planning.kitchen.rows import ABOVE

__all__ = ["carry", "walk_to"]


@kernel
def walk_to(k: Ints, s: Ints, o: int, w: Ints) -> int:
    """1 if somebody has to walk to deal with an object, 0 if somebody is there with free hands."""
    if w[ABOVE + o] >= 0:
        return 1
    place = pile_place(k, s, o)
    for p in range(k[PLAYERS]):
        if s[k[PLACE] + p] == place and s[k[HELD] + p] == 0:
            return 0
    return 1


@kernel
def carry(k: Ints, s: Ints) -> int:
    """1 if what is held has to be carried elsewhere before it is put down; 0 if that is open."""
    return 1 if k[PLAYERS] == 1 and not s[LOOSE] else 0
