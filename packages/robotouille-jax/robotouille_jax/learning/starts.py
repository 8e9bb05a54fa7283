"""First states of episodes: the task's own, or any state along a plan.

The sparse reward of a task of a dozen steps is rarely found by chance. From the last states of a
plan it is, and values learned there guide the episodes that start in the states before them
(docs/decisions/0059-starts-along-a-plan.md).
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from robotouille import RobotouilleError, State, World, load_certificate
from robotouille.planning.plan import read_plan
from robotouille.planning.policies.shift_policy import play_shift
from robotouille_jax.padded import Array

FIRST, PLAN = "first", "plan"
"""Names of the ways to start: always in the task's first state, or along a plan."""
REHEARSING = 4
"""One in so many copies always starts in the task's first state. The curves show these episodes."""
LAST = 0.25
"""Share of a run, at its end, in which all episodes start in the task's first state."""


def start_states(world: World, way: str) -> list[State]:
    """Return the states in which episodes can start, in the order of the plan.

    The plan is the task's certified one or, in a shift, the game of planner bots. Its last state,
    which has the goal, is left out.

    Raises:
        RobotouilleError: The task has no certified plan.
    """
    if way == FIRST:
        return [world.initial]
    if world.shift is not None:
        plan, _ = play_shift(world)
    else:
        lines = load_certificate(world.task).plan
        if lines is None:
            raise RobotouilleError(f"--starts plan: no plan of {world.task.name} is known")
        plan = read_plan("\n".join(lines), world)
    states = [world.initial]
    for joint in plan.steps[:-1]:
        states.append(states[-1].step(joint).state)
    return states


def draw_origins(states: int, left: Array, key: Array, copies: int) -> Array:
    """Draw the numbers of the states in which the copies start new episodes.

    Args:
        states: Number of states.
        left: Share of the run that is left.
    """
    drawn = jax.random.randint(key, (copies,), 0, states)
    first = (jnp.arange(copies) % REHEARSING == 0) | (left <= LAST)
    return jnp.where(first, 0, drawn)
