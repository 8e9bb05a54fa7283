"""Policy for shifts: all bots of a team plan together for the order that expires first."""

from __future__ import annotations

from collections.abc import Callable

from robotouille.planning.plan import Plan
from robotouille.planning.policies.agenda import OpenOrders
from robotouille.planning.policies.lockstep import play_in_lockstep
from robotouille.planning.policies.planner_policy import (
    DEFAULT_OPTIONS,
    PlannerOptions,
    PlannerPolicy,
)
from robotouille.planning.policies.policy import Did
from robotouille.planning.shift import DishPlanner, prepare_in_background, rules_of
from robotouille.world.world import State, World


class ShiftPolicy(PlannerPolicy):
    """Policy that serves the orders of a shift, the one that expires first before the others.

    Args:
        dishes: Planners of the dishes that several policies share, so that each dish is analysed
            once.
        start: The state from which `observe` follows the game.
        prepares: True to prepare the dishes in a thread, from the first step of the game.
    """

    def __init__(
        self,
        world: World,
        player: str,
        options: PlannerOptions = DEFAULT_OPTIONS,
        *,
        dishes: dict[str, DishPlanner] | None = None,
        start: State | None = None,
        prepares: bool = False,
    ) -> None:
        dishes = {} if dishes is None else dishes
        super().__init__(world, player, options, agenda=OpenOrders(world, dishes), start=start)
        self._unprepared = list(dishes.values()) if prepares else []

    def observe(self, did: Did) -> None:
        # Before the first step, a bot makes its first plan, which the thread would delay.
        if self._unprepared:
            prepare_in_background(self._unprepared)
            self._unprepared = []
        super().observe(did)


def play_shift(
    world: World, seed: int = 0, *, watch: Callable[[State], None] = lambda state: None
) -> tuple[Plan, State]:
    """Return the actions of planner bots in all seats of a shift in lockstep, and the last state.

    Args:
        watch: Function that is called with the state after each step.
    """
    rules, dishes = rules_of(world), dict[str, DishPlanner]()
    bots = {
        player: ShiftPolicy(
            world, player, PlannerOptions(seed=seed), dishes=dishes, start=world.initial
        )
        for player in world.players
    }
    return play_in_lockstep(world.initial, bots, rules.steps, watch=watch)
