"""Kernels that read states: they test the goal, list valid actions and write vectors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from robotouille.batch import layout as at
from robotouille.batch.tables import CopyRange, Ints
from robotouille.compiling import compiler, lowest_bit, unsigned

kernel = compiler(Path(__file__).parents[1], bare=True)
"""Decorator that compiles a kernel. Kernels must create neither arrays nor views of arrays."""

# Kernels wrap their indices in `unsigned`: for signed indices, numba also handles counting from an
# array's end, which costs about a sixth of the time.


@kernel
def get(t: Ints, name: int, i: int) -> int:
    """Return the i-th number of a list of the tables."""
    number: int = t[unsigned(t[unsigned(name)] + i)]
    return number


@kernel
def holds(t: Ints, row: Ints, rule: int) -> bool:
    """Return whether all tests of a rule hold."""
    place = t[at.RULE] + get(t, at.RULE_AT, rule)
    for test in range(place + 1, place + 1 + t[unsigned(place)], 3):
        if row[unsigned(t[unsigned(test)])] & t[unsigned(test + 1)] != t[unsigned(test + 2)]:
            return False
    return True


@kernel
def goal_reached(t: Ints, row: Ints, work: Ints) -> bool:
    """Return whether the goal holds, by backtracking.

    In the order of `goal_rule`, each condition takes its next choice that holds and whose objects
    agree with the objects chosen before.
    """
    conditions: int = t[at.CONDITIONS]
    # In most states some condition is met by no objects at all. Two cheap passes find that out
    # before the search begins.
    for condition in range(conditions):
        if not _possible(t, row, condition):
            return False
    for condition in range(conditions):
        if not _list_choices(t, row, work, condition):
            return False
    for variable in range(t[at.VARIABLES]):
        work[unsigned(t[at.BINDING] + variable)] = -1
    work[unsigned(t[at.CURSOR])] = 0
    # Numba compiles loops better than recursion, so the search keeps a cursor for each depth.
    depth = 0
    while 0 <= depth < conditions:
        _unbind(t, work, depth)
        if _advance(t, work, depth):
            depth += 1
            work[unsigned(t[at.CURSOR] + depth)] = 0
        else:
            depth -= 1
    return depth == conditions


@kernel
def _possible(t: Ints, row: Ints, condition: int) -> bool:
    """Return False if a condition needs one of some atoms and none of them is true."""
    first, last = get(t, at.NEED_AT, condition), get(t, at.NEED_AT, condition + 1)
    for i in range(first, last):
        if row[unsigned(get(t, at.NEED_WORD, i))] & get(t, at.NEED_MASK, i) != 0:
            return True
    return first == last


@kernel
def _list_choices(t: Ints, row: Ints, work: Ints, condition: int) -> bool:
    """List the choices of a condition whose atoms hold, and return whether there are any."""
    first = get(t, at.CHOICE_AT, condition)
    # If each choice needs exactly one atom (`_by_atom`), the true bits lead to the choices.
    # Otherwise every choice has to be tested.
    live = t[at.LIVE] + first
    count = 0
    for i in range(get(t, at.NEED_AT, condition), get(t, at.NEED_AT, condition + 1)):
        true = row[unsigned(get(t, at.NEED_WORD, i))] & get(t, at.NEED_MASK, i)
        while true != 0:
            choice = get(t, at.NEED_CHOICE, i) + lowest_bit(true)
            true &= true - 1
            work[unsigned(live + count)] = get(t, at.CHOICE_OF, choice)
            count += 1
    if get(t, at.NEED_AT, condition) == get(t, at.NEED_AT, condition + 1):
        for choice in range(first, get(t, at.CHOICE_AT, condition + 1)):
            if _atoms_hold(t, row, choice):
                work[unsigned(live + count)] = choice
                count += 1
    work[unsigned(t[at.LIVE_COUNT] + condition)] = count
    return count > 0


@kernel
def _atoms_hold(t: Ints, row: Ints, choice: int) -> bool:
    width = t[at.CHOSEN_ATOMS_WIDTH]
    for i in range(choice * width, (choice + 1) * width):
        atom = get(t, at.CHOSEN_ATOMS, i)
        if atom >= 0 and row[unsigned(atom // at.WORD)] >> (atom % at.WORD) & 1 == 0:
            return False
    return True


@kernel
def _advance(t: Ints, work: Ints, depth: int) -> bool:
    """Take a condition's next choice that agrees with the objects chosen so far."""
    cursor, live = t[at.CURSOR] + depth, t[at.LIVE] + get(t, at.CHOICE_AT, depth)
    while work[unsigned(cursor)] < work[unsigned(t[at.LIVE_COUNT] + depth)]:
        choice = work[unsigned(live + work[unsigned(cursor)])]
        work[unsigned(cursor)] += 1
        if _bind(t, work, depth, choice):
            return True
    return False


@kernel
def _unbind(t: Ints, work: Ints, depth: int) -> None:
    # Earlier conditions bound the other variables, and still need them.
    for i in range(get(t, at.VARIABLE_AT, depth), get(t, at.VARIABLE_AT, depth + 1)):
        if get(t, at.FRESH, i) != 0:
            work[unsigned(t[at.BINDING] + get(t, at.VARIABLE, i))] = -1


@kernel
def _bind(t: Ints, work: Ints, depth: int, choice: int) -> bool:
    """Bind a condition's variables to objects unless that contradicts earlier bindings."""
    first, last = get(t, at.VARIABLE_AT, depth), get(t, at.VARIABLE_AT, depth + 1)
    chosen = choice * t[at.CHOSEN_WIDTH] - first
    for i in range(first, last):
        thing = get(t, at.CHOSEN, chosen + i)
        if get(t, at.FRESH, i) == 0:
            if work[unsigned(t[at.BINDING] + get(t, at.VARIABLE, i))] != thing:
                return False
        elif _is_taken(t, work, get(t, at.VARIABLE, i), thing):
            return False
    for i in range(first, last):
        work[unsigned(t[at.BINDING] + get(t, at.VARIABLE, i))] = get(t, at.CHOSEN, chosen + i)
    return True


@kernel
def _is_taken(t: Ints, work: Ints, variable: int, thing: int) -> bool:
    """Return whether another variable of the same kind is bound to an object."""
    for other in range(t[at.VARIABLES]):
        alike = get(t, at.VARIABLE_KIND, other) == get(t, at.VARIABLE_KIND, variable)
        if alike and work[unsigned(t[at.BINDING] + other)] == thing:
            return True
    return False


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
