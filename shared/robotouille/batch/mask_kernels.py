"""Which actions are valid, as kernels: the tree of `match_tree` on words of atoms."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robotouille.batch import layout as at
from robotouille.batch.compiled import get, holds, kernel
from robotouille.batch.match_tree import MatchTree
from robotouille.batch.tables import Ints

__all__ = ["mask_copies", "random_copies", "vector_copies"]


@kernel
def _find_valid(t: Ints, tree: MatchTree, row: Ints, player: int, stack: Ints, found: Ints) -> int:
    """Write the numbers of a player's valid actions, in no order; returns how many there are."""
    count = 0
    if row[t[at.BUSY] + player] != 0:
        return 0
    first = get(t, at.ACTION_AT, player)
    stack[0] = tree.root[player]
    waiting = 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        for i in range(tree.action_at[node], tree.action_at[node + 1]):
            number = tree.action[i]
            if number < 0:
                number = -1 - number
                if not holds(t, row, first + number):
                    continue
            found[count] = number
            count += 1
        for group in range(tree.group_at[node], tree.group_at[node + 1]):
            true = row[tree.group_word[group]] & tree.group_mask[group]
            while true != 0:
                bit = true & -true
                true ^= bit
                child = tree.child[tree.child_at[group] + get(t, at.BIT_OF, bit % at.PRIME)]
                if child < 0:
                    found[count] = -2 - child
                    count += 1
                else:
                    stack[waiting] = child
                    waiting += 1
    return count


@kernel
def mask_copies(
    t: Ints,
    tree: MatchTree,
    rows: npt.NDArray[np.int64],
    player: int,
    first: int,
    last: int,
    masks: npt.NDArray[np.bool_],
    true: npt.NDArray[np.int32],
    stack: Ints,
    found: Ints,
) -> None:
    """The masks of some copies for a player.

    `true` lists what is true in each mask, behind the number of these, so that only that has to be
    made false; -1 stands for more than there is room for.
    """
    room = true.shape[1] - 1
    for copy in range(first, last):
        mask = masks[copy]
        count = true[copy, 0]
        if count < 0:
            mask[:] = False
        for i in range(count):
            mask[true[copy, 1 + i]] = False
        count = _find_valid(t, tree, rows[copy], player, stack, found)
        true[copy, 0] = count if count <= room else -1
        for i in range(count):
            mask[found[i]] = True
            if i < room:
                true[copy, 1 + i] = found[i]


@kernel
def random_copies(
    t: Ints,
    tree: MatchTree,
    rows: npt.NDArray[np.int64],
    draws: npt.NDArray[np.float64],
    first: int,
    last: int,
    actions: npt.NDArray[np.int64],
    stack: Ints,
    found: Ints,
) -> None:
    """One of each player's valid actions for some copies, by numbers from 0 up to 1."""
    for copy in range(first, last):
        for player in range(t[at.PLAYERS]):
            count = _find_valid(t, tree, rows[copy], player, stack, found)
            actions[copy, player] = found[int(draws[copy, player] * count)] if count > 0 else -1


@kernel
def vector_copies(
    t: Ints,
    tree: MatchTree,
    rows: npt.NDArray[np.int64],
    first: int,
    last: int,
    vectors: npt.NDArray[np.float32],
) -> None:
    """The vectors of some copies: atoms, effects with their counters, busy players."""
    vectors[first:last] = 0
    for copy in range(first, last):
        row, vector = rows[copy], vectors[copy]
        for word in range(t[at.WORDS]):
            true = row[word]
            while true != 0:
                bit = true & -true
                true ^= bit
                vector[word * at.WORD + get(t, at.BIT_OF, bit % at.PRIME)] = 1
        for i in range(row[t[at.COUNT]]):
            effect = row[t[at.ORDER] + i]
            # Each effect before it has a number of its own beside its counters.
            place = t[at.ATOMS] + effect + get(t, at.EFFECT_AT, effect)
            vector[place] = 1
            for node in range(get(t, at.EFFECT_AT, effect), get(t, at.EFFECT_AT, effect + 1)):
                vector[place + 1 + node - get(t, at.EFFECT_AT, effect)] = row[t[at.PROGRESS] + node]
        place = t[at.ATOMS] + t[at.EFFECTS] + get(t, at.EFFECT_AT, t[at.EFFECTS])
        for player in range(t[at.PLAYERS]):
            vector[place + player] = row[t[at.BUSY] + player]
