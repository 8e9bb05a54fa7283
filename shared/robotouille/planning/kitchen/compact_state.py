"""Records for the kernels: the kitchen, the goal, the compact state, and actions as integers.

A compact state stores each player's place and held object, what each object is on, where each meal
is, and the progress of work and delays. Objects are numbered: items first, then containers. Plain
tables are interchangeable and have no number. A pile on a plain table is identified by its lowest
object. Codes of places and of what an object is on, for n objects:

    0 … n-1                      another object (as a place: the table on which it is lowest)
    n … table_code-1             one of the stations with a purpose, in order
    table_code                   a plain table (as a place: an empty one)
    hand_code, hand_code+1 …     in a player's hand
    meal_code, meal_code+1 …     added to a meal

A counter is 0 until started and then 1. It increases after each step (a timed process, filling,
boiling) or each performance (a repeated process). A repeated process is done when its counter
reaches the total. A timer takes effect when its counter would exceed the total.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, TypeAlias

from robotouille.planning.kitchen.kernels import SMALL, Cube, Ints, Table, kernel

# The joint action of four players fills one 64-bit integer.
MAX_PLAYERS = 4

MAX_OBJECTS = 32
"""Maximum number of items and containers."""

# Objects and stations with a purpose share the six bits of an action's operand `x`.
MAX_NUMBERED = 63

# Meals and processes share the three bits of an action's operand `y`.
MAX_MEALS = MAX_PROCESSES = 7

# A station has one class. So each station needs one timer per item, one per pot, or one per meal
# and pot. Objects and stations together number at most 63.
MAX_TIMERS = MAX_MEALS * MAX_OBJECTS * (MAX_NUMBERED - MAX_OBJECTS)

MAX_COUNTERS = MAX_TIMERS + MAX_PROCESSES * MAX_OBJECTS

MAX_INTEGERS = 2 + 2 * MAX_PLAYERS + MAX_OBJECTS + 2 * MAX_MEALS + MAX_COUNTERS
"""Maximum number of integers in a state."""

NONE = -1
"""Table entry for no object, meal, process, class of stations or counter."""

WAIT, PICK, PUT, PROCESS, FILL, BOIL, ADD, POUR, MOVE = range(9)
"""Kinds of actions."""

PROCESSING, FILLING, BOILING = range(3)
"""Kinds of timers."""

POT, BOWL = 1, 2
"""Kinds of containers."""


# Rows by their index. Items are the first objects.
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
    """The constant part of a kitchen.

    Each station with a purpose has a *class*. All stations for one process have the same class.
    """

    players: int
    objects: int
    items: int
    stations: int  # with a purpose
    tables: int  # plain
    meals: int  # existing ones and those that the goal wants
    processes: int
    classes: int
    timers: int
    counters: int
    words: int  # length of a key
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
    possible: PerProcessAndItem  # 1: possible, perhaps after another process
    prerequisite: PerProcessAndItem  # the process that has to come first, or NONE
    total: PerProcessAndItem  # steps if timed, else performances
    progress: PerProcessAndItem  # a counter (timed: 1 when done) or NONE
    process_timer: Annotated[Cube, SMALL, MAX_PROCESSES, MAX_OBJECTS, MAX_NUMBERED]
    """A counter or NONE, by process, item and station."""
    fill_timer: PerObjectAndStation  # a counter or NONE
    boil_timer: Annotated[Cube, SMALL, MAX_MEALS, MAX_OBJECTS, MAX_NUMBERED]
    """A counter or NONE, by meal, pot and station."""
    container_kind: PerObject  # POT, BOWL or 0
    timer_counter: PerTimer
    timer_kind: PerTimer  # PROCESSING, FILLING, BOILING
    timer_object: PerTimer  # the object that has to be on the station
    timer_station: PerTimer  # code of that station
    timer_total: PerTimer  # steps
    timer_effect: PerTimer  # the counter to set to 1, the pot to fill, or the meal that boils
    key_word: PerPosition  # the word of a key that contains an integer
    key_shift: PerPosition  # its lowest bit in the word
    key_mask: PerPosition  # a mask of its width


@dataclass(slots=True)
class GoalSpec:
    """The goal for one assignment of objects to its variables."""

    about: PerObject  # 1: assigned to a variable
    wanted_process: PerProcessAndItem  # 1: the process has to be done
    on_table: PerObject  # 1: has to lie directly on a plain table
    pile: PerObject  # the lowest object of the required pile, or NONE
    clear: PerObject  # 1: nothing may be on the object
    atop: PerObject  # the object that has to be directly below, or NONE
    added_to: PerObject  # the meal that has to contain the object, or NONE
    wanted_meal: PerMeal  # 1: assigned to a variable
    vessel: PerMeal  # the required container, or NONE
    boiling: PerMeal  # 1: has to boil


@dataclass(slots=True)
class CompactState:
    """The variable part of a kitchen. No field is negative, so a state can be packed into a key."""

    assignment: int  # number of the goal assignment
    may_have_walked: int  # 1: the only player may have walked since the last pick-up
    place: PerPlayer  # the code of a place
    held: PerPlayer  # an object plus 1, or 0
    below: PerObject  # the code of what the object is on or in
    inside: PerMeal  # a container plus 1, or 0 if the meal does not exist yet
    boiled: PerMeal  # 1: it boils
    counters: PerCounter


def empty_state(kitchen: Kitchen) -> CompactState:
    """Return a state of zeros with rows for one kitchen."""
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
    """Copy one state into another."""
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
    """Return an action as one integer.

    The operands are: PICK x, PUT on x, PROCESS x by y, FILL x, BOIL meal x, ADD to meal x, POUR
    meal y into x, MOVE to x. Unused operands are 0.
    """
    return kind | x << 4 | y << 10


@kernel
def decode_action(action: int) -> tuple[int, int, int]:
    """Return the kind, `x` and `y` of an action."""
    return action & 15, action >> 4 & 63, action >> 10 & 7


# Keys. A state's integers are packed into words in the order of its fields. Searches keep millions
# of states, so memory limits them: the keys of the paper's tasks have one to three words for
# 7 to 35 integers.


@kernel
def pack_state(kitchen: Kitchen, state: CompactState, key: Ints) -> None:
    """Write a state's key, which has `kitchen.words` integers."""
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
    """Add a row of a state to its key and return the next position."""
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
    """Read a row of a state from its key and return the next position."""
    for i in range(length):
        word = keys[start + kitchen.key_word[position + i]]
        row[i] = word >> kitchen.key_shift[position + i] & kitchen.key_mask[position + i]
    return position + length
