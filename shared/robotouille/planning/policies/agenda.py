"""Goals of a policy, the most urgent one first: the goal of a task, or the orders of a shift."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Protocol

from robotouille.planning.policies.team_plan import TeamPlanner, TeamSearch
from robotouille.planning.shift import DishPlanner, rules_of
from robotouille.planning.solvers import AnytimePlanner
from robotouille.world.world import State, World


class Aim:
    """A goal: its planner, and the searches of a team for it."""

    def __init__(self, anytime: AnytimePlanner, *, seed: int, expansions: int, alone: bool) -> None:
        self.anytime = anytime
        self.search = TeamSearch(anytime, seed, expansions)
        self.planner = TeamPlanner(anytime, self.search, alone=alone)


class Agenda(Protocol):
    """Chooses goals. Equal states give equal goals, so that all bots of a team have the same."""

    def topic(self, state: State) -> Hashable:
        """Return a value that changes when a team has to plan again for other goals."""

    def goals(self, state: State) -> Sequence[AnytimePlanner]:
        """Return the planners of the goals in a state, the most urgent one first."""


class OneGoal:
    """Agenda of a task with one goal."""

    def __init__(self, anytime: AnytimePlanner) -> None:
        self._goals = (anytime,)

    def topic(self, state: State) -> Hashable:
        return None

    def goals(self, state: State) -> Sequence[AnytimePlanner]:
        return self._goals


class OpenOrders:
    """Agenda of a shift: the dishes of the open orders.

    Args:
        dishes: Planners of the dishes that several agendas share, so that each dish is analysed
            once.
    """

    def __init__(self, world: World, dishes: dict[str, DishPlanner]) -> None:
        self._world = world
        self._rules = rules_of(world)
        self._dishes = dishes

    def topic(self, state: State) -> Hashable:
        # Several orders in a row may be for the same dish.
        if state.orders is None or not state.orders.open:
            return None
        return state.orders.by_urgency[0].number, state.orders.served

    def goals(self, state: State) -> Sequence[AnytimePlanner]:
        orders = [] if state.orders is None else state.orders.by_urgency
        names = dict.fromkeys(self._rules.dish_name(order.number) for order in orders)
        return [self._planner(name).anytime for name in names]

    def _planner(self, name: str) -> DishPlanner:
        if name not in self._dishes:
            self._dishes[name] = DishPlanner(self._world, name)
        return self._dishes[name]
