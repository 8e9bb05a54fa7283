"""Rests of begun delays, and the walks back to them."""

from __future__ import annotations

from robotouille.planning.kitchen.bound.scratch import Scratch
from robotouille.planning.kitchen.compact_state import NONE, CompactState
from robotouille.planning.kitchen.kernels import Ints, kernel


@kernel
def least_left(state: CompactState, counters: Ints, total: int, stations: int, without: int) -> int:
    """Return the least rest of a begun delay at any station except one, or the delay's total.

    `counters` has the number of the delay's counter for each of the stations, or NONE.
    """
    left = total
    for station in range(stations):
        counter = counters[station]
        if station != without and counter != NONE and state.counters[counter] > 0:
            left = min(left, total - state.counters[counter])
    return left


@kernel
def return_walk(rest: int, walk: int, scratch: Scratch) -> int:
    """Return the steps in which a player walks back to a delay with a rest, or waits for its end.

    `walk` is the walk there.
    """
    # The delay may end with this step, and the player who put the object there has acted in it.
    return walk if rest == 1 and scratch.turns > 0 else 1
