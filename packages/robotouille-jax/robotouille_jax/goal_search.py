"""The goal test: a search for objects that meet all conditions."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from robotouille_jax.padded import Array, GoalTable

Search = tuple[Array, Array, Array]
"""The next condition, the choice taken for each condition, the object of each variable."""


def goal_reached(goal: GoalTable, atoms: Array) -> Array:
    """Return whether the goal holds, by the search of `robotouille.batch.state_kernels`."""
    conditions = len(goal.there)
    if not conditions:
        return jnp.ones((), bool)
    if not goal.there.shape[1]:
        return jnp.zeros((), bool)
    # All conditions are tested at once; the loop below only combines their choices.
    held = jnp.all(atoms.at[goal.atoms].get(mode="fill", fill_value=True), axis=-1) & goal.there
    possible = jnp.all(jnp.any(held, axis=1))
    numbers = jnp.arange(goal.there.shape[1])

    def goes_on(search: Search) -> Array:
        return (search[0] >= 0) & (search[0] < conditions)

    def go_on(search: Search) -> Search:
        depth, taken, binding = search
        variables, fresh = goal.variable[depth], goal.fresh[depth]
        binding = binding.at[jnp.where(fresh, variables, len(binding))].set(-1, mode="drop")
        fits = held[depth] & (numbers > taken[depth])
        for i in range(goal.variable.shape[1]):
            things = goal.objects[depth, :, i]
            alike = goal.kinds == goal.kinds[variables[i]]
            free = ~jnp.any(alike & (binding == things[:, None]), axis=1)
            same = (things == binding[variables[i]]) | (variables[i] == len(binding) - 1)
            fits &= jnp.where(fresh[i], free, same)
        found, choice = jnp.any(fits), jnp.argmax(fits)
        taken = taken.at[depth].set(jnp.where(found, choice, -1))
        places = jnp.where(found & fresh, variables, len(binding))
        binding = binding.at[places].set(goal.objects[depth, choice], mode="drop")
        return jnp.where(found, depth + 1, depth - 1), taken, binding

    start = (
        jnp.where(possible, 0, -1),
        jnp.full(conditions, -1, numbers.dtype),
        jnp.full(len(goal.kinds), -1, goal.objects.dtype),
    )
    return jax.lax.while_loop(goes_on, go_on, start)[0] == conditions
