"""Where things are in the arrays that kernels work on.

Kernels get few arrays, since each argument costs time where they are compiled and called. All
tables of a world are one array of 64-bit integers, `t`: its first numbers, which are named here,
are sizes and places, or say where in `t` a list begins. A list of lists of unequal length is two:
`X_AT`, where the i-th begins, and `X`; the i-th ends where the next begins.

A copy's state is a row: words of atoms, then for each kind of created objects how many slots are
in use (`TOP`), for each player how many steps it is busy (`BUSY`), 0 where the goal is known not to
hold (`GOAL`), the number of active effects (`COUNT`), these in order of creation (`ORDER`), and a
counter for each node (`PROGRESS`). A word holds 63 atoms, so it is never negative.

A rule says what is tested and written by an action (all players', one behind the other), a node
(from `FIRST_NODE` on), or a creation or deletion (`FIRST_OUTCOME`). It is a record of numbers: how
many follow for tests, these, how many follow for writes, and these. A test is a word, a mask, and
what the word has to be under that mask; a write is a word, what becomes true of it, and what
becomes false. An action's has its duration behind that, how many effects it starts, and these.

What a step writes on meanwhile is `work`: `STARTED` and `DELETED` say how many effects a run has
started and how many objects it has deleted, `HOLES` and `OVERFLOWED` whether a slot has become
empty, or was missing, in this step, `TOUCHED` which atoms have changed that the goal is about
(`RELEVANT`, by word). Behind these are the atoms about deleted objects (`GONE`, by
word), whether each object was deleted, the effects started, a copy of a row, and for the goal, of
each condition, the next choice, of each variable, the object that stands for it, and the choices
that each condition has now; at last the nodes of a tree that wait to be visited.
"""

from __future__ import annotations

__all__ = [
    "ABOUT",
    "ABOUT_AT",
    "ACTION_AT",
    "ATOMS",
    "ATOM_FROM",
    "BINDING",
    "BORN",
    "BORN_AT",
    "BUSY",
    "CHOICE_AT",
    "CHOICE_OF",
    "CHOSEN",
    "CHOSEN_ATOMS",
    "CHOSEN_ATOMS_WIDTH",
    "CHOSEN_WIDTH",
    "CONDITIONS",
    "COUNT",
    "CREATES",
    "CURSOR",
    "DELETED",
    "EFFECTS",
    "EFFECT_AT",
    "EFFECT_FROM",
    "END",
    "EXISTS",
    "FIRST_NODE",
    "FIRST_OUTCOME",
    "FRESH",
    "GOAL",
    "GONE",
    "HOLES",
    "IS_DELETED",
    "IS_STARTED",
    "KIND",
    "KINDS",
    "LIVE",
    "LIVE_COUNT",
    "MENTIONS",
    "MENTION_AT",
    "MENTION_WORD",
    "NEED_AT",
    "NEED_CHOICE",
    "NEED_MASK",
    "NEED_WORD",
    "NUMBERS",
    "OBJECTS",
    "ORDER",
    "OUTCOME",
    "OVERFLOWED",
    "PLAYERS",
    "PROGRESS",
    "RELEVANT",
    "ROOT",
    "ROW_COPY",
    "RULE",
    "RULE_AT",
    "SHIFTS",
    "SLOT_AT",
    "SLOT_OF",
    "STACK",
    "STARTED",
    "SUBJECT",
    "TOP",
    "TOTAL",
    "TOUCHED",
    "TREE",
    "VARIABLE",
    "VARIABLES",
    "VARIABLE_AT",
    "VARIABLE_KIND",
    "WIDTH",
    "WORD",
    "WORDS",
    "WORK_SIZE",
]

WORD = 63
"""Atoms in a word."""

# Sizes; places in a row; places in `work`.
(
    WORDS, ATOMS, PLAYERS, EFFECTS, OBJECTS, KINDS, SHIFTS, CONDITIONS, VARIABLES, CHOSEN_WIDTH,
    CHOSEN_ATOMS_WIDTH, FIRST_NODE, FIRST_OUTCOME,
    TOP, BUSY, GOAL, COUNT, ORDER, PROGRESS, WIDTH,
    GONE, IS_DELETED, IS_STARTED, ROW_COPY, CURSOR, BINDING, LIVE, LIVE_COUNT, STACK, WORK_SIZE,
) = range(30)  # fmt: skip

# Lists: of rules; of effects, their nodes and what these do; of objects and their
# slots; of the goal's conditions; of the trees of valid actions (`match_tree`).
(
    ACTION_AT, RULE_AT, RULE,
    EFFECT_AT, ABOUT_AT, ABOUT, KIND, END, TOTAL, SUBJECT, CREATES, OUTCOME,
    BORN_AT, BORN,
    MENTION_AT, MENTION_WORD, MENTIONS, SLOT_OF, SLOT_AT, EXISTS, ATOM_FROM, EFFECT_FROM,
    NEED_AT, NEED_WORD, NEED_MASK, VARIABLE_AT, VARIABLE, VARIABLE_KIND, FRESH, CHOICE_AT,
    CHOSEN, CHOSEN_ATOMS, NEED_CHOICE, CHOICE_OF,
    RELEVANT, ROOT, TREE,
) = range(30, 67)  # fmt: skip

NUMBERS = 67
"""Named numbers at the beginning of `t`."""

STARTED, DELETED, HOLES, OVERFLOWED, TOUCHED = range(5)
"""Places in `work`."""
