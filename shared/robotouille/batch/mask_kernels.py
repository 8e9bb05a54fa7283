"""Kernels that list valid actions and write states as vectors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robotouille.batch import layout as at
from robotouille.batch.goal_kernels import get, holds, kernel
from robotouille.batch.tables import CopyRange, Ints
from robotouille.compiling import lowest_bit, unsigned


@kernel
def _find_valid(t: Ints, row: Ints, work: Ints, player: int, found: Ints) -> int:
    """Write the numbers of a player's valid actions to `found`, in no order, and count them.

    The kernel walks the player's match tree (`match_tree`), so it never tests actions whose tree
    node is out of reach. Testing each action in turn would make masks grow with the task's size.
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
            # The tree tests only atoms that must be true. A negative number marks an action that
            # also has atoms that must be false.
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
                # Most leaves hold one action. They are stored in place of the node's position,
                # which saves a visit.
                if place < 0:
                    found[unsigned(count)] = -2 - place
                    count += 1
                else:
                    work[unsigned(stack + waiting)] = place
                    waiting += 1
    return count


@kernel
def mask_copies(
    block: CopyRange, player: int, masks: npt.NDArray[np.bool_], true: npt.NDArray[np.int32]
) -> None:
    """Write each copy's mask for one player.

    `true` lists the valid actions of each mask after their number, or has -1 if they do not fit.
    The next call clears only these: few actions are valid, and clearing a whole mask takes longer
    than finding them.
    """
    t, rows, row = block.tables, block.rows, block.row
    room = true.shape[1] - 1
    for copy in range(block.first, block.last):
        count = true[copy, 0]
        if count < 0:
            for i in range(masks.shape[1]):
                masks[copy, i] = False
        for i in range(count):
            masks[copy, unsigned(true[copy, 1 + i])] = False
        for i in range(t[at.GOAL]):
            row[i] = rows[copy, i]
        count = _find_valid(t, row, block.work, player, block.found)
        true[copy, 0] = count if count <= room else -1
        for i in range(count):
            masks[copy, unsigned(block.found[i])] = True
            if i < room:
                true[copy, 1 + i] = block.found[i]


@kernel
def joint_mask_copies(block: CopyRange, masks: npt.NDArray[np.int8], starts: Ints) -> None:
    """Write the masks of all players into zeros: player `i`'s mask begins at `starts[i]`."""
    t, rows, row = block.tables, block.rows, block.row
    for copy in range(block.first, block.last):
        for i in range(t[at.GOAL]):
            row[i] = rows[copy, i]
        _write_joint_mask(t, row, block.work, block.found, masks, copy, starts)


@kernel
def _write_joint_mask(
    t: Ints,
    row: Ints,
    work: Ints,
    found: Ints,
    masks: npt.NDArray[np.int8],
    copy: int,
    starts: Ints,
) -> None:
    for player in range(t[at.PLAYERS]):
        start = starts[player]
        for i in range(_find_valid(t, row, work, player, found)):
            masks[copy, unsigned(start + found[i])] = 1


@kernel
def valid_copies(
    block: CopyRange, actions: npt.NDArray[np.int64], valid: npt.NDArray[np.bool_]
) -> None:
    """Test each player's action in each copy; -1, for no action, is not valid."""
    t, rows, row = block.tables, block.rows, block.row
    for copy in range(block.first, block.last):
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
    block: CopyRange, draws: npt.NDArray[np.float64], actions: npt.NDArray[np.int64]
) -> None:
    """Choose one valid action for each player by a number in [0, 1); -1 if no action is valid."""
    t, rows, row = block.tables, block.rows, block.row
    for copy in range(block.first, block.last):
        for i in range(t[at.GOAL]):
            row[i] = rows[copy, i]
        for player in range(t[at.PLAYERS]):
            count = _find_valid(t, row, block.work, player, block.found)
            actions[copy, player] = (
                block.found[unsigned(int(draws[copy, player] * count))] if count > 0 else -1
            )


@kernel
def vector_copies(block: CopyRange, vectors: npt.NDArray[np.float32]) -> None:
    """Write the copies' states into zeros: atoms, effects with their counters, busy players."""
    t, rows, row = block.tables, block.rows, block.row
    for copy in range(block.first, block.last):
        for i in range(t[at.WIDTH]):
            row[i] = rows[copy, i]
        _write_vector(t, row, vectors, copy)


@kernel
def _write_vector(t: Ints, row: Ints, vectors: npt.NDArray[np.float32], copy: int) -> None:
    for word in range(t[at.WORDS]):
        true = row[unsigned(word)]
        while true != 0:
            vectors[copy, unsigned(word * at.WORD + lowest_bit(true))] = 1
            true &= true - 1
    for i in range(row[unsigned(t[at.COUNT])]):
        effect = row[unsigned(t[at.ORDER] + i)]
        start = get(t, at.EFFECT_AT, effect)
        # A vector has one number more for each effect than a row: whether it is active.
        place = t[at.ATOMS] + effect + start
        vectors[copy, place] = 1
        for node in range(start, get(t, at.EFFECT_AT, effect + 1)):
            vectors[copy, place + 1 + node - start] = row[unsigned(t[at.PROGRESS] + node)]
    place = t[at.ATOMS] + t[at.EFFECTS] + get(t, at.EFFECT_AT, t[at.EFFECTS])
    for player in range(t[at.PLAYERS]):
        vectors[copy, place + player] = row[unsigned(t[at.BUSY] + player)]


@kernel
def observe_row(
    t: Ints,
    row: Ints,
    work: Ints,
    found: Ints,
    vectors: npt.NDArray[np.float32],
    masks: npt.NDArray[np.int8],
    starts: Ints,
) -> None:
    """Write the vector and the masks of all players of one row into zeros, in arrays of one row.

    This is one kernel because for a single copy, the call costs more than the work.
    """
    _write_vector(t, row, vectors, 0)
    _write_joint_mask(t, row, work, found, masks, 0, starts)
