"""Goals of a policy, the most urgent one first: the goal of a task, or the orders of a shift."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Protocol

from robotouille.planning.policies.team_plan import TeamPlanner, TeamSearch
from robotouille.planning.shift import DishPlanner, rules_of
from robotouille.planning.solvers import AnytimePlanner
from robotouille.world.shift import OpenOrder
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
        return self._by_fit(state)[0].number, state.orders.served

    def goals(self, state: State) -> Sequence[AnytimePlanner]:
        orders = self._by_fit(state)
        return [*dict.fromkeys(self.planner(order) for order in orders)]

    def _by_fit(self, state: State) -> list[OpenOrder]:
        """Return the open orders by urgency, those first that fit what is on the hatch.

        Another dish would begin with taking apart what a player has put together.
        """
        if state.orders is None:
            return []
        orders, rules = state.orders.by_urgency, self._rules
        fitting = [o for o in orders if rules.fits(rules.dish_name(o.number), state.facts)]
        return [*fitting, *(order for order in orders if order not in fitting)]

    def planner(self, order: OpenOrder) -> AnytimePlanner:
        """Return the planner of an order's dish."""
        name = self._rules.dish_name(order.number)
        if name not in self._dishes:
            self._dishes[name] = DishPlanner(self._world, name)
        return self._dishes[name].anytime
