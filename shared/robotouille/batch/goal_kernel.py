"""Whether some choice of objects makes all conditions of the goal true, by backtracking.

Condition after condition, in the order of `goal_rule`, takes the next of its choices whose objects
agree with those chosen before, and whose atoms hold.
"""

from __future__ import annotations

from pathlib import Path

from robotouille.batch.tables import Ints, Tables
from robotouille.compiling import compiler

__all__ = ["goal_reached"]

kernel = compiler(Path(__file__).parent, nogil=True)

WORD = 63


@kernel
def goal_reached(t: Tables, row: Ints, cursor: Ints, binding: Ints) -> bool:
    """Whether the goal holds; most states fail at once, one of its conditions being met nowhere.

    `cursor` has room for a number for each condition, and one more; `binding` for each variable.
    """
    conditions = len(t.variable_at) - 1
    for condition in range(conditions):
        if not _possible(t, row, condition):
            return False
    binding[:] = -1
    depth = 0
    cursor[0] = t.choice_at[0]
    while 0 <= depth < conditions:
        _unbind(t, binding, depth)
        choice = cursor[depth]
        while choice < t.choice_at[depth + 1] and not _bind(t, row, binding, depth, choice):
            choice += 1
        if choice == t.choice_at[depth + 1]:
            depth -= 1
        else:
            cursor[depth] = choice + 1
            depth += 1
            cursor[depth] = t.choice_at[depth] if depth < conditions else 0
    return depth == conditions


@kernel
def _possible(t: Tables, row: Ints, condition: int) -> bool:
    """Whether some atom that meets a condition holds."""
    first, last = t.need_at[condition], t.need_at[condition + 1]
    for i in range(first, last):
        if row[t.need_word[i]] & t.need_mask[i] != 0:
            return True
    return first == last and t.choice_at[condition] < t.choice_at[condition + 1]


@kernel
def _unbind(t: Tables, binding: Ints, depth: int) -> None:
    for i in range(t.variable_at[depth], t.variable_at[depth + 1]):
        if t.fresh[i] != 0:
            binding[t.variable[i]] = -1


@kernel
def _bind(t: Tables, row: Ints, binding: Ints, depth: int, choice: int) -> bool:
    """Take a choice, if it agrees with the objects chosen so far and its atoms hold."""
    first, last = t.variable_at[depth], t.variable_at[depth + 1]
    for i in range(first, last):
        thing = t.chosen[choice, i - first]
        if t.fresh[i] == 0:
            if binding[t.variable[i]] != thing:
                return False
        elif _is_taken(t, binding, t.variable[i], thing):
            return False
    for i in range(t.chosen_atoms.shape[1]):
        atom = t.chosen_atoms[choice, i]
        if atom >= 0 and row[atom // WORD] >> (atom % WORD) & 1 == 0:
            return False
    for i in range(first, last):
        binding[t.variable[i]] = t.chosen[choice, i - first]
    return True


@kernel
def _is_taken(t: Tables, binding: Ints, variable: int, thing: int) -> bool:
    """Whether an object stands for another variable of the same kind."""
    for other in range(len(binding)):
        if binding[other] == thing and t.variable_kind[other] == t.variable_kind[variable]:
            return True
    return False
