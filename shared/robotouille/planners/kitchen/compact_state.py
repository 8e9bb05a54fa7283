"""The layout of a compact state, and of the two sequences that say what never changes.

A state of n objects (items, then containers) is a short sequence of integers: for every player its
place and what it holds, for every object what it is on, for every meal where it is, and counters.
Plain tables are alike, so they have no numbers: a pile on one is known by its lowest object. Codes
of what an object is on, of places and of supports:

    0 … n-1             another object (as a place: the plain table on which that is lowest)
    n … TABLE-1         one of the stations with a purpose
    TABLE               a plain table (as a place: an empty one)
    HAND, HAND+1 …      in a player's hand
    MEAL, MEAL+1 …      added to a meal

What never changes is one sequence for a kitchen, `k`, and one for its goal, `g`: kernels are
fastest with few arguments. `k[ITEMS]` is a number; `k[k[TIMER_SLOT] + i]` the i-th of a table.
Counters are 0 until started, then 1, and one more after each step (timed) or performance
(repeated); a process is done with its counter at its total plus 1 (timed) or at its total.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from robotouille.planners.kitchen.kernels import Ints, ints

__all__ = [
    "ABLE",
    "ADD",
    "AFTER",
    "ATOP",
    "BASE",
    "BELOW",
    "BOIL",
    "BOILED",
    "BOILING",
    "BOIL_TOTAL",
    "CLASSES",
    "DONE",
    "FILL",
    "FILLING",
    "FILL_TOTAL",
    "HAND",
    "HELD",
    "HOT",
    "INSIDE",
    "INTO",
    "IS_POT",
    "ITEMS",
    "LOOSE",
    "MEAL",
    "MEALS",
    "MOVE",
    "NEED",
    "OBJECTS",
    "PICK",
    "PILE",
    "PLACE",
    "PLAYERS",
    "POUR",
    "PROCESS",
    "PROCESSES",
    "PROCESS_CLASS",
    "PUT",
    "ROLE",
    "ROOT",
    "ROWS",
    "SHIFT",
    "SINK_CLASS",
    "SIZE",
    "STATIONS",
    "STATION_CLASS",
    "STOVE_CLASS",
    "TABLE",
    "TABLES",
    "TIMED",
    "TIMER",
    "TIMERS",
    "TIMER_EFFECT",
    "TIMER_KIND",
    "TIMER_OBJECT",
    "TIMER_SLOT",
    "TIMER_STATION",
    "TIMER_TOTAL",
    "TOP",
    "TOTAL",
    "VESSEL",
    "WAIT",
    "WANTED",
    "WORD",
    "WORDS",
    "laid_out",
]

# Kinds of actions.
WAIT, PICK, PUT, PROCESS, FILL, BOIL, ADD, POUR, MOVE = range(9)

# The first integers of a state: which choice of objects it is for (`r`), and whether the only
# player may have walked since it took what it holds.
ROOT, LOOSE = 0, 1

# Numbers of a kitchen: how many there are of each, codes, first positions in a state, totals.
PLAYERS, OBJECTS, ITEMS, STATIONS, TABLES, MEALS, PROCESSES, CLASSES, SIZE, WORDS, TIMERS = range(
    11
)
TABLE, HAND, MEAL = range(11, 14)
PLACE, HELD, BELOW, INSIDE, BOILED = range(14, 19)
SINK_CLASS, STOVE_CLASS, FILL_TOTAL, BOIL_TOTAL = range(19, 23)

# Tables of a kitchen. `q` is a process such as cutting, `c` a container counted from 0.
STATION_CLASS = 23  # [station] its class, -1 without
PROCESS_CLASS = 24  # [q]
TIMED = 25  # [q]
TOTAL = 26  # [q * ITEMS + item]
ABLE = 27  # [q * ITEMS + item]
AFTER = 28  # [q * ITEMS + item] the process that has to come first plus 1, or 0
DONE = 29  # [q * ITEMS + item] position of the counter or flag, -1 if of no interest
TIMER = 30  # [(q * ITEMS + item) * STATIONS + station] position of the counter, -1
FILLING = 31  # [c * STATIONS + station] position of the counter, -1
BOILING = 32  # [(meal * containers + c) * STATIONS + station] position of the counter, -1
IS_POT = 33  # [object] 1 a pot, 2 a bowl
TIMER_SLOT = 34  # [timer] position of its counter
TIMER_KIND = 35  # [timer] 0 a process, 1 filling, 2 boiling
TIMER_OBJECT = 36  # [timer] the object that has to be on the station
TIMER_STATION = 37  # [timer] the code of the station
TIMER_TOTAL = 38  # [timer]
TIMER_EFFECT = 39  # [timer] position of the flag it sets; filling: the container
WORD = 40  # [position] the word of a key in which it is packed
SHIFT = 41  # [position]

# Tables of a goal, with a row for each choice of objects `r`.
ROWS = 0
ROLE = 1  # [r * OBJECTS + object] whether the goal is about it
NEED = 2  # [(r * PROCESSES + q) * ITEMS + item]
BASE = 3  # [r * OBJECTS + object] whether it has to be on a plain table itself
PILE = 4  # [r * OBJECTS + item] the lowest object of the pile it has to be in plus 1, or 0
TOP = 5  # [r * OBJECTS + item] whether nothing may be on it
ATOP = 6  # [r * OBJECTS + item] the object it has to be on plus 1, or 0
INTO = 7  # [r * OBJECTS + item] the meal it has to be in plus 1, or 0
WANTED = 8  # [r * MEALS + meal] whether the goal is about it
VESSEL = 9  # [r * MEALS + meal] the container it has to be in plus 1, or 0
HOT = 10  # [r * MEALS + meal] whether it has to boil


def laid_out(numbers: Mapping[int, int], tables: Mapping[int, Sequence[int]]) -> Ints:
    """One sequence of numbers and tables; a table's entry is where it begins."""
    size = len(numbers) + len(tables)
    head = [0] * size
    body: list[int] = []
    for position, number in numbers.items():
        head[position] = number
    for position, values in tables.items():
        head[position] = size + len(body)
        body += values
    return ints(head + body)
