"""Progress towards a goal: the largest share of its conditions that hold at once.

A condition about several objects counts only if all conditions about one of these objects alone
hold, too: a patty counts on the burger when it is cooked, and a bun on top when nothing is on it.
Otherwise a policy learns to stack raw things, which brings no goal nearer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import chain, islice

import jax.numpy as jnp
import numpy as np
import numpy.typing as npt

from robotouille.batch.rules import ConditionRule, GoalRule
from robotouille.errors import RobotouilleError
from robotouille_jax.padded import Array

MOST = 20_000
"""Assignments of objects to the variables of a goal, which are all tested in each state."""


def progress_of(goal: GoalRule, atoms: int) -> Callable[[Array], Array]:
    """Return a function from a state's atoms to minus the share of unmet conditions.

    Raises:
        RobotouilleError: The function was called, and the goal has too many assignments.
    """
    assignments = list(islice(_assignments(goal), MOST + 1))
    if not goal.conditions or not assignments or len(assignments) > MOST:
        return _Unknown(len(assignments))
    choices = [{choice.objects: choice.atoms for choice in c.choices} for c in goal.conditions]
    deepest = max((len(atoms) for atoms in chain(*(c.values() for c in choices))), default=0)
    # One number beyond the atoms is always true, and the next one always false.
    needed = np.full((len(assignments), len(choices), max(1, deepest)), atoms, np.int32)
    for i, binding in enumerate(assignments):
        for j, condition in enumerate(goal.conditions):
            objects = tuple(binding[variable] for variable in condition.variables)
            found = choices[j].get(objects, (atoms + 1,))
            needed[i, j, : len(found)] = found
    table, first = jnp.asarray(needed), jnp.asarray(_first(goal))

    def progress(state: Array) -> Array:
        both = jnp.concatenate([state, jnp.array([True, False])])
        held = jnp.all(both[table], axis=-1)
        missing = (~held).astype(jnp.float32) @ first
        counted = held & (missing == 0)
        return jnp.max(counted.mean(-1, dtype=jnp.float32)) - 1

    return progress


def _first(goal: GoalRule) -> npt.NDArray[np.float32]:
    """Return 1 where the row's condition has to hold before the column's condition counts."""
    variables = [set(condition.variables) for condition in goal.conditions]
    return np.array([[len(a) == 1 and a < b for b in variables] for a in variables], np.float32)


class _Unknown:
    """Progress of a goal for which it is not computed."""

    def __init__(self, assignments: int) -> None:
        self._found = "none" if not assignments else f"more than {MOST}"

    def __call__(self, state: Array) -> Array:
        raise RobotouilleError(
            f"the goal has {self._found} assignments of objects; train with the sparse reward"
        )


def _assignments(goal: GoalRule) -> Iterator[Mapping[int, int]]:
    """Yield all objects for all variables, different ones for variables of one kind."""
    pools = {variable: _objects(goal.conditions, variable) for variable in range(len(goal.kinds))}

    def extended(binding: dict[int, int], variable: int) -> Iterator[dict[int, int]]:
        if variable == len(goal.kinds):
            yield dict(binding)
            return
        kind = goal.kinds[variable]
        taken = {thing for other, thing in binding.items() if goal.kinds[other] == kind}
        for thing in pools[variable]:
            if thing not in taken:
                yield from extended({**binding, variable: thing}, variable + 1)

    return extended({}, 0)


def _objects(conditions: tuple[ConditionRule, ...], variable: int) -> list[int]:
    """Return the objects that some condition allows for a variable."""
    return sorted({
        choice.objects[condition.variables.index(variable)]
        for condition in conditions
        if variable in condition.variables
        for choice in condition.choices
    })  # fmt: skip
