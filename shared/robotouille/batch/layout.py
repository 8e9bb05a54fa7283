"""Layout of the arrays that kernels read and write.

Kernels take few arrays because each argument costs time when they are compiled and called.

Tables
    All tables of a world are one array of 64-bit integers, `t`. It begins with the numbers named
    here: sizes, positions, and for each list its start in `t`. A list of lists is two lists: `X_AT`
    has the start of each part, and `X` the parts. A part ends where the next one begins.

Rows
    The state of a copy is a row, in this order: words of atoms; for each kind of created object,
    the number of filled slots (`TOP`); for each player, the number of steps for which it is busy
    (`BUSY`); 0 if the goal is known not to hold (`GOAL`); the number of active effects (`COUNT`);
    the active effects in order of creation (`ORDER`); a counter for each node (`PROGRESS`).

Rules
    A rule has the tests and writes of an action, of an effect's node (from `FIRST_NODE` on), or of
    a creation or deletion (from `FIRST_OUTCOME` on). Its record is: count of the tests' numbers,
    the tests, count of the writes' numbers, the writes. A test is a word, a mask, and the value
    of the word under the mask. A write is a word, the bits that become 1, and the bits that
    become 0. An action's record continues with its duration, the number of effects that it
    starts, and these effects.

Work
    A step stores temporary values in `work`. A run is the update of one action's effects, or of
    all effects at the end of a step. The flags are the number of effects that the run has started
    (`STARTED`), the number of objects that it has deleted (`DELETED`), whether a slot became empty
    in this step (`HOLES`), whether a slot was missing (`OVERFLOWED`), and the changed atoms that
    the goal mentions (`TOUCHED`). Then come: the atoms about deleted objects by word (`GONE`), a
    flag for each deleted object (`IS_DELETED`), the started effects (`IS_STARTED`), a copy of a
    row (`ROW_COPY`), the goal search (`CURSOR` for each condition, `BINDING` for each variable,
    `LIVE` choices and their number), and the tree nodes that wait to be visited (`STACK`).
"""

from __future__ import annotations

WORD = 63
"""Atoms in a word. 63 keep the sign bit clear, so shifts and comparisons need no special case."""

# Sizes; positions in a row; positions in `work`.
(
    WORDS, ATOMS, PLAYERS, EFFECTS, OBJECTS, KINDS, SHIFTS, CONDITIONS, VARIABLES, CHOSEN_WIDTH,
    CHOSEN_ATOMS_WIDTH, FIRST_NODE, FIRST_OUTCOME,
    TOP, BUSY, GOAL, COUNT, ORDER, PROGRESS, WIDTH,
    GONE, IS_DELETED, IS_STARTED, ROW_COPY, CURSOR, BINDING, LIVE, LIVE_COUNT, STACK, WORK_SIZE,
) = range(30)  # fmt: skip

# Lists of rules; of effects, their nodes and outcomes; of objects and their slots; of the goal's
# conditions; of the trees of valid actions (`match_tree`).
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
"""Positions of the flags in `work`."""
