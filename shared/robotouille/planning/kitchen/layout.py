"""The layout of a compact state: which integer means what, and what never changes.

A state of `n` objects (items, then containers) is a short sequence of integers: for every player
its place and what it holds, for every object what it is on, for every meal where it is, and
counters. Plain tables are alike, so they have no numbers: a pile on one is known by its lowest
object. Codes of what an object is on, of places and of supports:

    0 … n-1         another object (as a place: the plain table on which that object is lowest)
    n … n+s-1       one of the s stations with a purpose
    table = n+s     a plain table (as a place: an empty one)
    hand, hand+1 …  in a player's hand
    meal, meal+1 …  added to a meal
"""

from __future__ import annotations

from typing import NamedTuple

from robotouille.planning.kitchen.compiled import Ints

__all__ = [
    "ADD",
    "BOIL",
    "FILL",
    "LOOSE",
    "MOVE",
    "PICK",
    "POUR",
    "PROCESS",
    "PUT",
    "ROOT",
    "WAIT",
    "Goals",
    "Kitchen",
]

WAIT, PICK, PUT, PROCESS, FILL, BOIL, ADD, POUR, MOVE = range(9)

ROOT, LOOSE = 0, 1
"""The first integers of a state: which choice of objects it is for (its row in `Goals`), and
whether the only player may have walked since it took what it holds."""


class Kitchen(NamedTuple):
    """What never changes. Sequences are indexed as said; `q` is a process such as cutting.

    `first_*` are positions in a state. Counters are 0 until started, then 1, and one more after
    each step (timed) or performance (repeated); a process is done with its counter at its total
    plus 1 (timed) or its total (repeated).
    """

    players: int
    n: int
    items: int
    stations: int
    tables: int
    meals: int
    processes: int
    classes: int
    size: int
    table: int
    hand: int
    meal: int
    place: int
    held: int
    below: int
    inside: int
    boiled: int
    station_class: Ints  # [station] class, -1 without
    process_class: Ints  # [q]
    sink_class: int
    stove_class: int
    timed: Ints  # [q]
    total: Ints  # [q * items + item]
    able: Ints  # [q * items + item]
    after: Ints  # [q * items + item]: the process that has to come first plus 1, or 0
    done: Ints  # [q * items + item] position of the counter or flag, -1 if of no interest
    timer: Ints  # [(q * items + item) * stations + station] position, -1
    fill: Ints  # [(container - items) * stations + station] position, -1
    boil: Ints  # [(meal * (n - items) + container - items) * stations + station] position, -1
    fill_total: int
    boil_total: int
    is_pot: Ints  # [object]
    timers: int
    timer_slot: Ints  # [timer] position of its counter
    timer_kind: Ints  # [timer] 0 a process, 1 filling, 2 boiling
    timer_object: Ints  # [timer] the object that has to be on the station
    timer_station: Ints  # [timer] the code of the station
    timer_total: Ints  # [timer]
    timer_effect: Ints  # [timer] position of the flag it sets; filling: the container
    words: int
    word: Ints  # [position] the word of a key in which it is packed
    shift: Ints  # [position]


class Goals(NamedTuple):
    """The choices of objects that meet the goal, one row each (`r`)."""

    rows: int
    role: Ints  # [r * n + object] whether the goal is about it
    need: Ints  # [(r * processes + q) * items + item]
    base: Ints  # [r * n + object] whether it has to be on a plain table itself
    pile: Ints  # [r * n + item] the lowest object of the pile it has to be in plus 1, or 0
    top: Ints  # [r * n + item] whether nothing may be on it
    atop: Ints  # [r * n + item] the object it has to be on plus 1, or 0
    into: Ints  # [r * n + item] the meal it has to be in plus 1, or 0
    wanted: Ints  # [r * meals + meal] whether the goal is about it
    vessel: Ints  # [r * meals + meal] the container it has to be in plus 1, or 0
    hot: Ints  # [r * meals + meal] whether it has to boil
