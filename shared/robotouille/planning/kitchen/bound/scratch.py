"""Notes about one state that the parts of the heuristic share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from robotouille.planning.kitchen.compact_state import (
    MAX_MEALS,
    MAX_OBJECTS,
    NONE,
    CompactState,
    Kitchen,
    PerObject,
)
from robotouille.planning.kitchen.kernels import Ints, kernel
from robotouille.planning.kitchen.transitions import place_of_object

DEAD_END = 1 << 20
"""A heuristic value from which on the goal cannot be met any more."""


@dataclass(slots=True)
class Scratch:
    """Work space. Every field is reset for each state, unless its description names an owner."""

    turns: int
    """Players of a team that have acted in the first step."""
    free_hands: int
    """Objects that are only taken off others and need not be put down again."""
    water_walks: int
    """Walks to a pot with water that players save if they come to add something."""
    maybe_added: int
    """Items that may be added to a pot."""
    meal_chain: int
    """Longest chain of a meal."""
    filling_chain: int
    """Shortest chain of a meal whose pot has to be filled."""
    pots_open: int
    """1 if several pots may serve for a meal."""
    above: PerObject
    """[object] The object on top, or NONE."""
    deliveries: PerObject
    """[object] Number of times the object still has to be carried."""
    works_here: PerObject
    """[object] 1 if a process has to be started or performed at its place."""
    leaves: PerObject
    """[object] 1 if the object has to leave its place."""
    stops: PerObject
    """[object] Classes of stations that the object still has to reach, as a bit set."""
    first_stop: PerObject
    """[object] First of these classes; NONE if it is not determined or the next place is the last.
    """
    stay: PerObject
    """[item] Steps of the process at its station, or at its first stop if that is determined."""
    work: PerObject
    """[object] Steps of players that deal with the object."""
    chain: PerObject
    """[object] Steps, delays included, until the object can be at its final place."""
    tail: PerObject
    """[item] Steps after the last work on the item. Owned by `shared_work`."""
    before: Annotated[Ints, 2 * MAX_OBJECTS + MAX_MEALS]
    """[node] Nodes that have to come later, as a bit set. Owned by the cycle packing."""


def new_scratch() -> Scratch:
    """Return work space for any state of any kitchen."""
    # Full size for any kitchen: records have a fixed size anyway.
    return Scratch(
        turns=0,
        free_hands=0,
        water_walks=0,
        maybe_added=0,
        meal_chain=0,
        filling_chain=0,
        pots_open=0,
        above=[0] * MAX_OBJECTS,
        deliveries=[0] * MAX_OBJECTS,
        works_here=[0] * MAX_OBJECTS,
        leaves=[0] * MAX_OBJECTS,
        stops=[0] * MAX_OBJECTS,
        first_stop=[0] * MAX_OBJECTS,
        stay=[0] * MAX_OBJECTS,
        work=[0] * MAX_OBJECTS,
        chain=[0] * MAX_OBJECTS,
        tail=[0] * MAX_OBJECTS,
        before=[0] * (2 * MAX_OBJECTS + MAX_MEALS),
    )


@kernel
def clear_scratch(kitchen: Kitchen, state: CompactState, turns: int, scratch: Scratch) -> None:
    """Reset the notes, and note the turns and what is on what."""
    scratch.turns = turns
    scratch.free_hands = 0
    scratch.water_walks = 0
    scratch.maybe_added = 0
    scratch.meal_chain = 0
    scratch.filling_chain = DEAD_END
    scratch.pots_open = 0
    for o in range(kitchen.objects):
        scratch.above[o] = NONE
        scratch.deliveries[o] = 0
        scratch.works_here[o] = 0
        scratch.leaves[o] = 0
        scratch.stops[o] = 0
        scratch.first_stop[o] = NONE
        scratch.stay[o] = 0
        scratch.work[o] = 0
        scratch.chain[o] = 0
    for o in range(kitchen.items):
        if state.below[o] < kitchen.objects:
            scratch.above[state.below[o]] = o


@kernel
def walk_to(kitchen: Kitchen, state: CompactState, o: int, scratch: Scratch) -> int:
    """Return 1 if a player has to walk to deal with an object, else 0."""
    # The player's last action at the place was about an object above, and the object above is
    # carried away before this one can be handled.
    if scratch.above[o] != NONE:
        return 1
    place = place_of_object(kitchen, state, o)
    for p in range(kitchen.players):
        if state.place[p] == place and state.held[p] == 0:
            return 0
    return 1


@kernel
def walk_before_put(kitchen: Kitchen, state: CompactState) -> int:
    """Return 1 if the held object has to be carried elsewhere before it is put down, else 0."""
    # A single player puts nothing back where it was picked up (`applicable.is_of_use`).
    return 1 if kitchen.players == 1 and not state.may_have_walked else 0
