"""The walks before an action."""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import (
    HELD,
    LOOSE,
    PLACE,
    PLAYERS,
)
from robotouille.planners.kitchen.heuristic.scratch_rows import ABOVE
from robotouille.planners.kitchen.kernels import Ints, kernel
from robotouille.planners.kitchen.transitions import pile_place

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
