"""Kernels that test the goal by backtracking.

In the order of `goal_rule`, each condition takes its next choice that holds and whose objects
agree with the objects chosen before.
"""

from __future__ import annotations

from pathlib import Path

from robotouille.batch import layout as at
from robotouille.batch.tables import Ints
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
    """Return whether the goal holds."""
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
