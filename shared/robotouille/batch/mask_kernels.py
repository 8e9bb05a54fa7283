"""Which actions are valid, as kernels: the tree of `match_tree` on words of atoms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from robotouille.batch.tables import Ints, Tables
from robotouille.compiling import compiler

__all__ = ["find_valid", "mask_copies", "random_copies", "vector_copies"]

kernel = compiler(Path(__file__).parent, nogil=True)

WORD = 63


@kernel
def _forbidden(t: Tables, row: Ints, action: int) -> bool:
    for i in range(t.test_at[action], t.test_at[action + 1]):
        if row[t.test_word[i]] & t.tested[i] != t.required[i]:
            return True
    return False


@kernel
def find_valid(t: Tables, row: Ints, player: int, stack: Ints, found: Ints) -> int:
    """Write the numbers of a player's valid actions, in no order; returns how many there are."""
    count = 0
    if row[t.busy + player] != 0:
        return 0
    tree, first = t.tree, t.action_at[player]
    stack[0] = tree.root[player]
    waiting = 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        for i in range(tree.action_at[node], tree.action_at[node + 1]):
            number = tree.action[i]
            if number < 0:
                number = -1 - number
                if _forbidden(t, row, first + number):
                    continue
            found[count] = number
            count += 1
        for group in range(tree.group_at[node], tree.group_at[node + 1]):
            true = row[tree.group_word[group]] & tree.group_mask[group]
            while true != 0:
                bit = true & -true
                true ^= bit
                child = tree.child[tree.child_at[group] + tree.bit_of[bit % 67]]
                if child < 0:
                    found[count] = -2 - child
                    count += 1
                else:
                    stack[waiting] = child
                    waiting += 1
    return count


@kernel
def mask_copies(
    t: Tables,
    rows: npt.NDArray[np.int64],
    player: int,
    first: int,
    last: int,
    masks: npt.NDArray[np.bool_],
    stack: Ints,
    found: Ints,
) -> None:
    """The masks of some copies for a player."""
    masks[first:last] = False
    for copy in range(first, last):
        mask = masks[copy]
        for i in range(find_valid(t, rows[copy], player, stack, found)):
            mask[found[i]] = True


@kernel
def random_copies(
    t: Tables,
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
        for player in range(t.players):
            count = find_valid(t, rows[copy], player, stack, found)
            actions[copy, player] = found[int(draws[copy, player] * count)] if count > 0 else -1


@kernel
def vector_copies(
    t: Tables,
    rows: npt.NDArray[np.int64],
    first: int,
    last: int,
    vectors: npt.NDArray[np.float32],
) -> None:
    """The vectors of some copies: atoms, effects with their counters, busy players."""
    vectors[first:last] = 0
    for copy in range(first, last):
        row, vector = rows[copy], vectors[copy]
        for word in range(t.words):
            true = row[word]
            while true != 0:
                bit = true & -true
                true ^= bit
                vector[word * WORD + t.tree.bit_of[bit % 67]] = 1
        for i in range(row[t.count]):
            effect = row[t.order + i]
            # Each effect before it has a number of its own beside its counters.
            place = t.atoms + effect + t.effect_at[effect]
            vector[place] = 1
            for node in range(t.effect_at[effect], t.effect_at[effect + 1]):
                vector[place + 1 + node - t.effect_at[effect]] = row[t.progress + node]
        place = t.atoms + len(t.effect_at) - 1 + t.effect_at[-1]
        for player in range(t.players):
            vector[place + player] = row[t.busy + player]
