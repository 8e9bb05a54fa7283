"""Whether some choice of objects makes all conditions of the goal true, by backtracking.

Condition after condition, in the order of `goal_rule`, takes the next of its choices whose objects
agree with those chosen before, and whose atoms hold.
"""

from __future__ import annotations

from robotouille.batch import layout as at
from robotouille.batch.compiled import get, kernel
from robotouille.batch.tables import Ints

__all__ = ["goal_reached"]


@kernel
def goal_reached(t: Ints, row: Ints, work: Ints) -> bool:
    """Whether the goal holds; most states fail at once, one of its conditions being met nowhere."""
    conditions = t[at.CONDITIONS]
    for condition in range(conditions):
        if not _possible(t, row, condition):
            return False
    work[t[at.BINDING] : t[at.WORK_SIZE]] = -1
    depth = 0
    work[t[at.CURSOR]] = get(t, at.CHOICE_AT, 0)
    while 0 <= depth < conditions:
        _unbind(t, work, depth)
        choice = work[t[at.CURSOR] + depth]
        while choice < get(t, at.CHOICE_AT, depth + 1) and not _bind(t, row, work, depth, choice):
            choice += 1
        if choice == get(t, at.CHOICE_AT, depth + 1):
            depth -= 1
        else:
            work[t[at.CURSOR] + depth] = choice + 1
            depth += 1
            work[t[at.CURSOR] + depth] = get(t, at.CHOICE_AT, depth) if depth < conditions else 0
    return depth == conditions


@kernel
def _possible(t: Ints, row: Ints, condition: int) -> bool:
    """Whether some atom that meets a condition holds."""
    first, last = get(t, at.NEED_AT, condition), get(t, at.NEED_AT, condition + 1)
    for i in range(first, last):
        if row[get(t, at.NEED_WORD, i)] & get(t, at.NEED_MASK, i) != 0:
            return True
    return first == last and get(t, at.CHOICE_AT, condition) < get(t, at.CHOICE_AT, condition + 1)


@kernel
def _unbind(t: Ints, work: Ints, depth: int) -> None:
    for i in range(get(t, at.VARIABLE_AT, depth), get(t, at.VARIABLE_AT, depth + 1)):
        if get(t, at.FRESH, i) != 0:
            work[t[at.BINDING] + get(t, at.VARIABLE, i)] = -1


@kernel
def _bind(t: Ints, row: Ints, work: Ints, depth: int, choice: int) -> bool:
    """Take a choice, if it agrees with the objects chosen so far and its atoms hold."""
    first, last = get(t, at.VARIABLE_AT, depth), get(t, at.VARIABLE_AT, depth + 1)
    for i in range(first, last):
        thing = get(t, at.CHOSEN, choice * t[at.CHOSEN_WIDTH] + i - first)
        if get(t, at.FRESH, i) == 0:
            if work[t[at.BINDING] + get(t, at.VARIABLE, i)] != thing:
                return False
        elif _is_taken(t, work, get(t, at.VARIABLE, i), thing):
            return False
    for i in range(t[at.CHOSEN_ATOMS_WIDTH]):
        atom = get(t, at.CHOSEN_ATOMS, choice * t[at.CHOSEN_ATOMS_WIDTH] + i)
        if atom >= 0 and row[atom // at.WORD] >> (atom % at.WORD) & 1 == 0:
            return False
    for i in range(first, last):
        thing = get(t, at.CHOSEN, choice * t[at.CHOSEN_WIDTH] + i - first)
        work[t[at.BINDING] + get(t, at.VARIABLE, i)] = thing
    return True


@kernel
def _is_taken(t: Ints, work: Ints, variable: int, thing: int) -> bool:
    """Whether an object stands for another variable of the same kind."""
    for other in range(t[at.VARIABLES]):
        alike = get(t, at.VARIABLE_KIND, other) == get(t, at.VARIABLE_KIND, variable)
        if alike and work[t[at.BINDING] + other] == thing:
            return True
    return False
