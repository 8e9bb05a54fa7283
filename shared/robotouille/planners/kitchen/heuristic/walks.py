"""The walks before an action."""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import NONE, CompactState, Kitchen
from robotouille.planners.kitchen.heuristic.scratch import Scratch
from robotouille.planners.kitchen.kernels import kernel
from robotouille.planners.kitchen.transitions import place_of_object

__all__ = ["walk_before_put", "walk_to"]


@kernel
def walk_to(kitchen: Kitchen, state: CompactState, o: int, scratch: Scratch) -> int:
    """1 if somebody has to walk to deal with an object, 0 if somebody is there with free hands."""
    if scratch.above[o] != NONE:
        return 1
    place = place_of_object(kitchen, state, o)
    for p in range(kitchen.players):
        if state.place[p] == place and state.held[p] == 0:
            return 0
    return 1


@kernel
def walk_before_put(kitchen: Kitchen, state: CompactState) -> int:
    """1 if what is held has to be carried elsewhere before it is put down; 0 if that is open."""
    return 1 if kitchen.players == 1 and not state.may_have_walked else 0
