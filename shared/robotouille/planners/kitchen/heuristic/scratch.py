"""What the parts of the heuristic note for one another about one state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from robotouille.planners.kitchen.compact_state import (
    MAX_MEALS,
    MAX_OBJECTS,
    NONE,
    CompactState,
    Kitchen,
    PerObject,
)
from robotouille.planners.kitchen.kernels import Ints, kernel

__all__ = ["DEAD_END", "Scratch", "clear_scratch", "new_scratch"]

DEAD_END = 1 << 20
"""A heuristic from which on the goal cannot be met any more."""


@dataclass(slots=True)
class Scratch:
    """Scratch space. Whatever is not said to be of a bound's own is set for each state anew."""

    free_hands: int
    """Objects that are only taken off others, and need not be put down again."""
    water_walks: int
    """Walks to a pot with water in it, which are saved by whoever comes to add something."""
    maybe_added: int
    """Things that may be added to a pot."""
    meal_chain: int
    """The longest chain of a meal."""
    pots_open: int
    """Whether it is open which pot is for which meal."""
    above: PerObject
    """[object] what is on top of it, NONE."""
    deliveries: PerObject
    """[object] how many more times it has to be carried."""
    works_here: PerObject
    """[object] whether a process has to be started or performed where it is."""
    leaves: PerObject
    """[object] whether it has to be taken from where it is."""
    stops: PerObject
    """[object] classes of stations that it still has to be brought to, as a bit set."""
    first_stop: PerObject
    """[object] the first of them; NONE if that is open, or the next place is the last."""
    work: PerObject
    """[object] steps of players that are about it."""
    chain: PerObject
    """[object] steps, delays included, until it can be where it has to be."""
    before: Annotated[Ints, 2 * MAX_OBJECTS + MAX_MEALS]
    """[node] what has to come after a delivery, as a bit set: the cycle packing's own."""


def new_scratch() -> Scratch:
    """Scratch space for any state of any kitchen."""
    return Scratch(
        free_hands=0,
        water_walks=0,
        maybe_added=0,
        meal_chain=0,
        pots_open=0,
        above=[0] * MAX_OBJECTS,
        deliveries=[0] * MAX_OBJECTS,
        works_here=[0] * MAX_OBJECTS,
        leaves=[0] * MAX_OBJECTS,
        stops=[0] * MAX_OBJECTS,
        first_stop=[0] * MAX_OBJECTS,
        work=[0] * MAX_OBJECTS,
        chain=[0] * MAX_OBJECTS,
        before=[0] * (2 * MAX_OBJECTS + MAX_MEALS),
    )


@kernel
def clear_scratch(kitchen: Kitchen, state: CompactState, scratch: Scratch) -> None:
    """Forget what was noted, and note what is on what."""
    scratch.free_hands = 0
    scratch.water_walks = 0
    scratch.maybe_added = 0
    scratch.meal_chain = 0
    scratch.pots_open = 0
    for o in range(kitchen.objects):
        scratch.above[o] = NONE
        scratch.deliveries[o] = 0
        scratch.works_here[o] = 0
        scratch.leaves[o] = 0
        scratch.stops[o] = 0
        scratch.first_stop[o] = NONE
        scratch.work[o] = 0
        scratch.chain[o] = 0
    for o in range(kitchen.items):
        if state.below[o] < kitchen.objects:
            scratch.above[state.below[o]] = o
