"""Policy for shifts: all bots of a team plan together for the order that expires first."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from robotouille.planning.plan import Plan
from robotouille.planning.policies.planner_policy import (
    DEFAULT_OPTIONS,
    PlannerOptions,
    PlannerPolicy,
)
from robotouille.planning.policies.policy import Did, Speech, waits
from robotouille.planning.policies.team_talk import no_plan_text
from robotouille.planning.shift import DishPlanner, rules_of
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World

NO_ORDER = -1


class ShiftPolicy:
    """Policy that aims a `PlannerPolicy` at the dish of one order after the other.

    Every seat chooses the same order in the same step, so the bots of a team plan alike.

    Args:
        dishes: Planners of the dishes that several policies share, so that each dish is analysed
            once.
        start: The state from which `observe` follows the game.
    """

    def __init__(
        self,
        world: World,
        player: str,
        options: PlannerOptions = DEFAULT_OPTIONS,
        *,
        dishes: dict[str, DishPlanner] | None = None,
        start: State | None = None,
    ) -> None:
        self._rules = rules_of(world)
        self._world = world
        self._dishes = {} if dishes is None else dishes
        self._dish = dish = self._dish_planner(next(iter(self._rules.menu)))
        self._policy = PlannerPolicy(dish.world, player, options, anytime=dish.anytime)
        self._state: State | None = None
        self._order = NO_ORDER
        if start is not None:
            self._follow(start)

    @property
    def anticipating(self) -> bool:
        """True if the last action relies on another seat's action in the same step."""
        return self._policy.anticipating

    @property
    def waiting(self) -> bool:
        """True if the seat waits for a place or a participant."""
        return self._order != NO_ORDER and waits(self._policy)

    def act(self, state: State) -> GroundAction | None:
        if state != self._state:
            # The seat has joined, or returned after an absence.
            self._follow(state, returned=self._state is not None)
        if self._order == NO_ORDER:
            return None
        dish = self._dish
        return dish.shift_action(self._policy.act(dish.state(state)))

    def _dish_planner(self, name: str) -> DishPlanner:
        if name not in self._dishes:
            self._dishes[name] = DishPlanner(self._world, name)
        return self._dishes[name]

    def _follow(self, state: State, *, returned: bool = False) -> None:
        """Aim at the most urgent order of a state."""
        self._state = state
        urgent = [] if state.orders is None else state.orders.by_urgency
        order = urgent[0].number if urgent else NO_ORDER
        if order != NO_ORDER:
            dish = self._dish_planner(self._rules.dish_name(order))
            # The world of a dish does not know that served and discarded things return.
            if order != self._order or returned or not self._policy.expects(state.facts):
                self._dish, here = dish, dish.state(state)
                self._policy.aim_at(dish.world, dish.anytime, here, returned=returned)
        self._order = order

    # Events

    def observe(self, did: Did) -> None:
        own = self._dish.own_action
        self._policy.observe([(player, own(a), applied) for player, a, applied in did])
        if self._state is not None:
            actions = [a for _, a, applied in did if applied]
            self._follow(self._state.step([self._own(a) for a in actions]).state)

    def _own(self, action: GroundAction) -> GroundAction:
        self._world.admit(action.arguments)
        return self._world.action(action.name, *action.arguments)

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        self._policy.meet(kinds, clock)

    def hear(self, player: str, speech: Speech) -> None:
        self._policy.hear(player, speech)

    def speak(self) -> list[Speech]:
        # A shift has no goal. The next order may be possible.
        return [said for said in self._policy.speak() if said.text != no_plan_text()]


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
    for bot in bots.values():
        bot.meet(dict.fromkeys(bots, "bot"), "lockstep")
    state, steps = world.initial, list[tuple[GroundAction, ...]]()
    while state.orders is not None and not rules.over(state.orders):
        decided = [
            (bot.anticipating, action)
            for player, bot in bots.items()
            if not state.busy_steps(player) and (action := bot.act(state)) is not None
        ]
        # An action that relies on another one of the same step comes after it.
        step = state.step([action for _, action in sorted(decided, key=lambda pair: pair[0])])
        steps.append(tuple(each.action for each in step.attempts if each.applied))
        did = [(each.action.player or "", each.action, each.applied) for each in step.attempts]
        for bot in bots.values():
            bot.observe(did)
        for player, bot in bots.items():
            for speech in bot.speak():
                for other in bots.values():
                    other.hear(player, speech)
        state = step.state
        watch(state)
    return Plan(tuple(steps)), state
