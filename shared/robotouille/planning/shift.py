"""Plans for shifts: each dish is a task of its own, which all planners can plan."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from robotouille.errors import RobotouilleError
from robotouille.planning.solvers import AnytimePlanner
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.shift import ShiftRules
from robotouille.world.world import State, World


class DishPlanner:
    """One dish of a shift as a task whose goal is the dish, with its anytime planner.

    The objects and facts are those of the shift, so states and actions can be translated.
    """

    def __init__(self, world: World, dish: str) -> None:
        changes = {"shift": None, "goal": rules_of(world).menu[dish].goal}
        problem = world.task.problem.model_copy(update=changes)
        self._shift_world = world
        self.world = World(replace(world.task, name=f"{world.task.name}: {dish}", problem=problem))

    @cached_property
    def anytime(self) -> AnytimePlanner:
        """The planner of the dish, which analyses the kitchen once."""
        return AnytimePlanner(self.world)

    def state(self, state: State) -> State:
        """Return a state of the shift as a state of this task."""
        return self.world.restore(state.facts, state.timer_rows(), state.timers.busy)

    def own_action(self, action: GroundAction) -> GroundAction:
        """Return an action of the shift as an action of this task."""
        self.world.admit(action.arguments)
        return self.world.action(action.name, *action.arguments)

    def shift_action(self, action: GroundAction | None) -> GroundAction | None:
        """Return an action of this task as an action of the shift."""
        if action is None:
            return None
        self._shift_world.admit(action.arguments)
        return self._shift_world.action(action.name, *action.arguments)


def rules_of(world: World) -> ShiftRules:
    """Return the rules of a world's shift.

    Raises:
        RobotouilleError: The task has no shift.
    """
    if world.shift is None:
        raise RobotouilleError(f"{world.task.name} has no shift")
    return world.shift
