"""What the kernels work on: a kitchen, a goal, a compact state, and actions as integers.

A compact state says of each player where it is and what it holds, of each object what it is on,
of each meal where it is, and how far work and delays have got. Objects have numbers: items, then
containers. Plain tables are alike, so they have none: a pile on one is known by its lowest object.
Codes of places and of what an object is on, for n objects:

    0 … n-1                      another object (as a place: the table on which that is lowest)
    n … table_code-1             one of the stations with a purpose, in their order
    table_code                   a plain table (as a place: an empty one)
    hand_code, hand_code+1 …     in a player's hand
    meal_code, meal_code+1 …     added to a meal

Counters are 0 until started, then 1, and one more after each step (a timed process, filling,
boiling) or each performance (a repeated process). A repeated process is done with its counter at
its total; what takes time sets a flag when its counter would exceed the total.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, TypeAlias

from robotouille.planners.kitchen.kernels import SMALL, Cube, Ints, Table, kernel

__all__ = [
    "ACTION_BITS",
    "ADD",
    "BOIL",
    "BOILING",
    "BOWL",
    "FILL",
    "FILLING",
    "MAX_MEALS",
    "MAX_NUMBERED",
    "MAX_OBJECTS",
    "MAX_PLAYERS",
    "MAX_PROCESSES",
    "MOVE",
    "NONE",
    "PICK",
    "POT",
    "POUR",
    "PROCESS",
    "PROCESSING",
    "PUT",
    "WAIT",
    "CompactState",
    "Goal",
    "Kitchen",
    "copy_state",
    "decode_action",
    "empty_state",
    "encode_action",
    "pack_state",
    "unpack_state",
]

MAX_PLAYERS = 4
"""A joint action of more does not fit into one integer."""

MAX_OBJECTS = 32
"""Items and containers together."""

MAX_NUMBERED = 63
"""Objects and stations with a purpose together: an action has six bits for one of them."""

MAX_MEALS = MAX_PROCESSES = 7
"""An action has three bits for one of them."""

MAX_TIMERS = MAX_MEALS * MAX_OBJECTS * (MAX_NUMBERED - MAX_OBJECTS)
"""A station is of one class, so there is a timer for an item on a station, or one for a pot, or one
for each meal in a pot; and objects and stations are 63 together."""

MAX_COUNTERS = MAX_TIMERS + MAX_PROCESSES * MAX_OBJECTS

MAX_INTEGERS = 2 + 2 * MAX_PLAYERS + MAX_OBJECTS + 2 * MAX_MEALS + MAX_COUNTERS
"""Integers of a state."""

NONE = -1
"""In tables: no object, meal, process, class of stations or counter."""

WAIT, PICK, PUT, PROCESS, FILL, BOIL, ADD, POUR, MOVE = range(9)
"""Kinds of actions."""

PROCESSING, FILLING, BOILING = range(3)
"""Kinds of timers."""

POT, BOWL = 1, 2
"""Kinds of containers."""


# Rows by what they are indexed with. Items come first of the objects.
PerPlayer: TypeAlias = Annotated[Ints, SMALL, MAX_PLAYERS]
PerObject: TypeAlias = Annotated[Ints, SMALL, MAX_OBJECTS]
PerStation: TypeAlias = Annotated[Ints, SMALL, MAX_NUMBERED]
PerMeal: TypeAlias = Annotated[Ints, SMALL, MAX_MEALS]
PerProcess: TypeAlias = Annotated[Ints, SMALL, MAX_PROCESSES]
PerTimer: TypeAlias = Annotated[Ints, SMALL, MAX_TIMERS]
PerCounter: TypeAlias = Annotated[Ints, SMALL, MAX_COUNTERS]
PerPosition: TypeAlias = Annotated[Ints, SMALL, MAX_INTEGERS]
PerProcessAndItem: TypeAlias = Annotated[Table, SMALL, MAX_PROCESSES, MAX_OBJECTS]
PerObjectAndStation: TypeAlias = Annotated[Table, SMALL, MAX_OBJECTS, MAX_NUMBERED]


@dataclass(slots=True)
class Kitchen:
    """What never changes.

    Stations with a purpose are of a *class* each: all those for one process are of one class.
    """

    players: int
    objects: int
    items: int
    stations: int  # with a purpose
    tables: int  # plain
    meals: int  # that exist, or that the goal wants
    processes: int
    classes: int
    timers: int
    counters: int
    words: int  # of a key
    table_code: int
    hand_code: int
    meal_code: int
    sink_class: int
    stove_class: int
    fill_total: int  # steps
    boil_total: int  # steps
    station_class: PerStation  # or NONE
    process_class: PerProcess
    timed: PerProcess  # 1: takes time, 0: is performed repeatedly
    possible: PerProcessAndItem  # 1: it is, perhaps after another
    prerequisite: PerProcessAndItem  # the process that comes first, or NONE
    total: PerProcessAndItem  # steps if timed, else performances
    progress: PerProcessAndItem  # a counter (timed: 1 when done) or NONE
    process_timer: Annotated[Cube, SMALL, MAX_PROCESSES, MAX_OBJECTS, MAX_NUMBERED]
    """By process, item and station, a counter or NONE."""
    fill_timer: PerObjectAndStation  # a counter or NONE
    boil_timer: Annotated[Cube, SMALL, MAX_MEALS, MAX_OBJECTS, MAX_NUMBERED]
    """By meal, pot and station, a counter or NONE."""
    container_kind: PerObject  # POT, BOWL or 0
    timer_counter: PerTimer
    timer_kind: PerTimer  # PROCESSING, FILLING, BOILING
    timer_object: PerTimer  # what has to be on the station
    timer_station: PerTimer  # its code
    timer_total: PerTimer  # steps
    timer_effect: PerTimer  # the counter it sets to 1, the pot it fills, the meal that boils
    key_word: PerPosition  # the word of a key in which an integer is packed
    key_shift: PerPosition  # its lowest bit there
    key_mask: PerPosition  # as many bits as it takes


@dataclass(slots=True)
class Goal:
    """What has to hold in the end, for one assignment of objects to the goal's variables."""

    about: PerObject  # 1: it is assigned to a variable
    wanted_process: PerProcessAndItem  # 1: has to be done
    on_table: PerObject  # 1: has to be on a plain table itself
    pile: PerObject  # the lowest object of the pile it has to be in, or NONE
    clear: PerObject  # 1: nothing may be on it
    atop: PerObject  # the object it has to be on, or NONE
    added_to: PerObject  # the meal it has to be in, or NONE
    wanted_meal: PerMeal  # 1: it is assigned to a variable
    vessel: PerMeal  # the container it has to be in, or NONE
    boiling: PerMeal  # 1: has to boil


@dataclass(slots=True)
class CompactState:
    """What changes. No field is negative, so that a state can be packed into a key."""

    assignment: int  # which goal the search from here is for
    may_have_walked: int  # 1: the only player may have walked since it took what it holds
    place: PerPlayer  # the code of a place
    held: PerPlayer  # an object plus 1, or 0
    below: PerObject  # the code of what it is on or in
    inside: PerMeal  # a container plus 1, or 0 if not yet made
    boiled: PerMeal  # 1: it boils
    counters: PerCounter


def empty_state(kitchen: Kitchen) -> CompactState:
    """All zeros, as long as a kitchen needs."""
    players, objects, meals = kitchen.players, kitchen.objects, kitchen.meals
    return CompactState(
        0,
        0,
        [0] * players,
        [0] * players,
        [0] * objects,
        [0] * meals,
        [0] * meals,
        [0] * kitchen.counters,
    )


@kernel
def copy_state(kitchen: Kitchen, source: CompactState, target: CompactState) -> None:
    """Make one state equal to another."""
    target.assignment = source.assignment
    target.may_have_walked = source.may_have_walked
    for p in range(kitchen.players):
        target.place[p] = source.place[p]
        target.held[p] = source.held[p]
    for o in range(kitchen.objects):
        target.below[o] = source.below[o]
    for m in range(kitchen.meals):
        target.inside[m] = source.inside[m]
        target.boiled[m] = source.boiled[m]
    for i in range(kitchen.counters):
        target.counters[i] = source.counters[i]


# Actions: four bits for the kind, six for `x`, three for `y`.

ACTION_BITS = 13


@kernel
def encode_action(kind: int, x: int, y: int) -> int:
    """An action as one integer.

    PICK x, PUT on x, PROCESS x by y, FILL x, BOIL meal x, ADD to meal x, POUR meal y into x, MOVE
    to x; a number that a kind does not mention is 0.
    """
    return kind | x << 4 | y << 10


@kernel
def decode_action(action: int) -> tuple[int, int, int]:
    """The kind, `x` and `y` of an action."""
    return action & 15, action >> 4 & 63, action >> 10 & 7


# Keys. The integers of a state, in the order of its fields, are packed into words.


@kernel
def pack_state(kitchen: Kitchen, state: CompactState, key: Ints) -> None:
    """Write a state's key, of `kitchen.words` integers."""
    for i in range(kitchen.words):
        key[i] = 0
    key[0] = state.assignment | state.may_have_walked << kitchen.key_shift[1]
    at = pack_row(kitchen, state.place, kitchen.players, 2, key)
    at = pack_row(kitchen, state.held, kitchen.players, at, key)
    at = pack_row(kitchen, state.below, kitchen.objects, at, key)
    at = pack_row(kitchen, state.inside, kitchen.meals, at, key)
    at = pack_row(kitchen, state.boiled, kitchen.meals, at, key)
    pack_row(kitchen, state.counters, kitchen.counters, at, key)


@kernel
def pack_row(kitchen: Kitchen, row: Ints, length: int, position: int, key: Ints) -> int:
    """Add a row of a state to its key; returns the position of what follows."""
    for i in range(length):
        key[kitchen.key_word[position + i]] |= row[i] << kitchen.key_shift[position + i]
    return position + length


@kernel
def unpack_state(kitchen: Kitchen, keys: Ints, start: int, state: CompactState) -> None:
    """Read a state from its key, which begins at `start`."""
    state.assignment = keys[start] & kitchen.key_mask[0]
    state.may_have_walked = keys[start] >> kitchen.key_shift[1] & 1
    at = unpack_row(kitchen, keys, start, 2, state.place, kitchen.players)
    at = unpack_row(kitchen, keys, start, at, state.held, kitchen.players)
    at = unpack_row(kitchen, keys, start, at, state.below, kitchen.objects)
    at = unpack_row(kitchen, keys, start, at, state.inside, kitchen.meals)
    at = unpack_row(kitchen, keys, start, at, state.boiled, kitchen.meals)
    unpack_row(kitchen, keys, start, at, state.counters, kitchen.counters)


@kernel
def unpack_row(
    kitchen: Kitchen, keys: Ints, start: int, position: int, row: Ints, length: int
) -> int:
    """Read a row of a state from its key; returns the position of what follows."""
    for i in range(length):
        word = keys[start + kitchen.key_word[position + i]]
        row[i] = word >> kitchen.key_shift[position + i] & kitchen.key_mask[position + i]
    return position + length
