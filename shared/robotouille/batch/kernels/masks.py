"""Which actions are valid, and what a state is as a vector: kernels."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robotouille.batch import layout as at
from robotouille.batch.kernels.compiled import get, holds, kernel
from robotouille.batch.tables import Ints
from robotouille.compiling import lowest_bit, unsigned

__all__ = [
    "joint_mask_copies",
    "look_copies",
    "mask_copies",
    "random_copies",
    "valid_copies",
    "vector_copies",
]


@kernel
def _find_valid(t: Ints, row: Ints, work: Ints, player: int, found: Ints) -> int:
    """Write the numbers of a player's valid actions, in no order; returns how many there are.

    It goes through the player's tree: see `match_tree`.
    """
    if row[unsigned(t[at.BUSY] + player)] != 0:
        return 0
    count = 0
    tree, stack = t[at.TREE], t[at.STACK]
    work[unsigned(stack)] = get(t, at.ROOT, player)
    waiting = 1
    while waiting > 0:
        waiting -= 1
        node = tree + work[unsigned(stack + waiting)]
        tests = node + 1 + t[unsigned(node)]
        for i in range(node + 1, tests):
            number = t[i]
            if number < 0:
                number = -1 - number
                if not holds(t, row, get(t, at.ACTION_AT, player) + number):
                    continue
            found[unsigned(count)] = number
            count += 1
        for test in range(tests + 1, tests + 1 + t[unsigned(tests)], 3):
            true = row[unsigned(t[unsigned(test)])] & t[unsigned(test + 1)]
            below = tree + t[unsigned(test + 2)]
            while true != 0:
                place = t[unsigned(below + lowest_bit(true))]
                true &= true - 1
                if place < 0:
                    found[unsigned(count)] = -2 - place
                    count += 1
                else:
                    work[unsigned(stack + waiting)] = place
                    waiting += 1
    return count


@kernel
def mask_copies(
    t: Ints,
    rows: npt.NDArray[np.int64],
    row: Ints,
    work: Ints,
    player: int,
    first: int,
    last: int,
    masks: npt.NDArray[np.bool_],
    true: npt.NDArray[np.int32],
    found: Ints,
) -> None:
    """The masks of some copies for a player.

    `true` lists what is true in each mask, behind the number of these, so that only that has to be
    made false; -1 stands for more than there is room for.
    """
    room = true.shape[1] - 1
    for copy in range(first, last):
        count = true[copy, 0]
        if count < 0:
            for i in range(masks.shape[1]):
                masks[copy, i] = False
        for i in range(count):
            masks[copy, unsigned(true[copy, 1 + i])] = False
        for i in range(t[at.GOAL]):
            row[i] = rows[copy, i]
        count = _find_valid(t, row, work, player, found)
        true[copy, 0] = count if count <= room else -1
        for i in range(count):
            masks[copy, unsigned(found[i])] = True
            if i < room:
                true[copy, 1 + i] = found[i]


@kernel
def joint_mask_copies(
    t: Ints,
    rows: npt.NDArray[np.int64],
    row: Ints,
    work: Ints,
    first: int,
    last: int,
    masks: npt.NDArray[np.int8],
    starts: Ints,
    found: Ints,
) -> None:
    """The masks of some copies, zeros before: those of players one behind the other, each where
    `starts` says."""
    for copy in range(first, last):
        for i in range(t[at.GOAL]):
            row[i] = rows[copy, i]
        for player in range(t[at.PLAYERS]):
            start = starts[player]
            for i in range(_find_valid(t, row, work, player, found)):
                masks[copy, unsigned(start + found[i])] = 1


@kernel
def valid_copies(
    t: Ints,
    rows: npt.NDArray[np.int64],
    row: Ints,
    actions: npt.NDArray[np.int64],
    first: int,
    last: int,
    valid: npt.NDArray[np.bool_],
) -> None:
    """Whether each player's action is valid in some copies, -1 for none, which is not."""
    for copy in range(first, last):
        for i in range(t[at.GOAL]):
            row[i] = rows[copy, i]
        for player in range(t[at.PLAYERS]):
            number = actions[copy, player]
            valid[copy, player] = (
                number >= 0
                and row[unsigned(t[at.BUSY] + player)] == 0
                and holds(t, row, get(t, at.ACTION_AT, player) + number)
            )


@kernel
def random_copies(
    t: Ints,
    rows: npt.NDArray[np.int64],
    row: Ints,
    work: Ints,
    draws: npt.NDArray[np.float64],
    first: int,
    last: int,
    actions: npt.NDArray[np.int64],
    found: Ints,
) -> None:
    """One of each player's valid actions for some copies, by numbers from 0 up to 1."""
    for copy in range(first, last):
        for i in range(t[at.GOAL]):
            row[i] = rows[copy, i]
        for player in range(t[at.PLAYERS]):
            count = _find_valid(t, row, work, player, found)
            actions[copy, player] = (
                found[unsigned(int(draws[copy, player] * count))] if count > 0 else -1
            )


@kernel
def vector_copies(
    t: Ints,
    rows: npt.NDArray[np.int64],
    first: int,
    last: int,
    vectors: npt.NDArray[np.float32],
) -> None:
    """The vectors of some copies, zeros before: atoms, effects with counters, busy players."""
    for copy in range(first, last):
        for word in range(t[at.WORDS]):
            true = rows[copy, word]
            while true != 0:
                vectors[copy, unsigned(word * at.WORD + lowest_bit(true))] = 1
                true &= true - 1
        for i in range(rows[copy, t[at.COUNT]]):
            effect = rows[copy, t[at.ORDER] + i]
            start = get(t, at.EFFECT_AT, effect)
            # Each effect before it has a number of its own beside its counters.
            place = t[at.ATOMS] + effect + start
            vectors[copy, place] = 1
            for node in range(start, get(t, at.EFFECT_AT, effect + 1)):
                counter = rows[copy, t[at.PROGRESS] + node]
                vectors[copy, place + 1 + node - start] = counter
        place = t[at.ATOMS] + t[at.EFFECTS] + get(t, at.EFFECT_AT, t[at.EFFECTS])
        for player in range(t[at.PLAYERS]):
            vectors[copy, place + player] = rows[copy, t[at.BUSY] + player]


@kernel
def look_copies(
    t: Ints,
    rows: npt.NDArray[np.int64],
    row: Ints,
    work: Ints,
    first: int,
    last: int,
    vectors: npt.NDArray[np.float32],
    masks: npt.NDArray[np.int8],
    starts: Ints,
    found: Ints,
) -> None:
    """The vectors and the masks of all players: a call of a kernel costs more than that of a
    copy."""
    vector_copies(t, rows, first, last, vectors)
    joint_mask_copies(t, rows, row, work, first, last, masks, starts, found)
