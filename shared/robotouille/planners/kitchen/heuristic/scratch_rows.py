"""Rows of the scratch space of an estimate: 32 integers each, one for each object."""

from __future__ import annotations

__all__ = [
    "ABOVE",
    "CHAIN",
    "CHAIN_OF_MEALS",
    "CLEAR_ONLY",
    "DEAD",
    "FIRST",
    "HERE",
    "JOINED",
    "LEAVES",
    "LEGS",
    "NEEDS",
    "NEXT",
    "SCRATCH",
    "SHARED",
    "TOTALS",
    "WET",
    "WORK",
]

DEAD = 1 << 20
"""An estimate from which on the goal cannot be met."""

ABOVE = 0
"""The object on top of one, or -1."""
LEGS = 32
"""How many more times an object has to be carried."""
HERE = 64
"""Whether a process has to be started or performed where an object is."""
LEAVES = 96
"""Whether an object has to be taken from where it is."""
NEEDS = 128
"""The classes of stations an object still has to be brought to, as a bit set."""
FIRST = 160
"""The class of the first of them plus 1; 0 if that is open, or the next place is the last."""
WORK = 192
"""Actions of players that an object still needs."""
CHAIN = 224
"""Steps, delays included, until an object can be where it has to be."""
NEXT = 256
"""Which leg has to come before which: a bit set for each of up to 63 legs (two rows)."""
TOTALS = 320
CLEAR_ONLY = TOTALS + 1
"""How many objects have to be taken off something and need not be put down again."""
WET = TOTALS + 2
"""Walks to a pot with water in it, which are saved by whoever comes to add something."""
JOINED = TOTALS + 3
"""How many things may be added to a pot."""
CHAIN_OF_MEALS = TOTALS + 4
SHARED = TOTALS + 5
"""Whether it is open which pot is for which meal."""
SCRATCH = TOTALS + 32
