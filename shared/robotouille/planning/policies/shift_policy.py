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

MAX_HEARD = 64
"""Messages that are repeated to the policy of the next order, such as who plans together."""


class ShiftPolicy:
    """Policy that serves one order after the other, each with a `PlannerPolicy` for its dish.

    Every seat chooses the same order, so the bots of a team plan for the same dish.

    Args:
        dishes: Planners of the dishes that several policies share, so that each dish is analysed
            once.
    """

    def __init__(
        self,
        world: World,
        player: str,
        options: PlannerOptions = DEFAULT_OPTIONS,
        *,
        dishes: dict[str, DishPlanner] | None = None,
    ) -> None:
        self._rules = rules_of(world)
        self._world = world
        self._player = player
        self._options = options
        self._dishes = {} if dishes is None else dishes
        self._dish: DishPlanner | None = None
        self._policy: PlannerPolicy | None = None
        self._order = -1
        self._met: tuple[dict[str, str], str] | None = None
        self._heard: list[tuple[str, Speech]] = []
        self._spoken: set[Speech] = set()

    @property
    def anticipating(self) -> bool:
        """True if the last action relies on another seat's action in the same step."""
        return self._policy is not None and self._policy.anticipating

    @property
    def waiting(self) -> bool:
        """True if the seat waits for a place or a participant."""
        return self._policy is not None and waits(self._policy)

    def act(self, state: State) -> GroundAction | None:
        urgent = [] if state.orders is None else state.orders.by_urgency
        if not urgent:
            self._order, self._policy = -1, None
            return None
        order = urgent[0]
        dish = self._dish_planner(self._rules.dish_name(order.number))
        if self._policy is None or order.number != self._order:
            self._order, self._dish = order.number, dish
            self._policy = self._new_policy(dish, state)
        return dish.shift_action(self._policy.act(dish.state(state)))

    def _dish_planner(self, name: str) -> DishPlanner:
        if name not in self._dishes:
            self._dishes[name] = DishPlanner(self._world, name)
        return self._dishes[name]

    def _new_policy(self, dish: DishPlanner, state: State) -> PlannerPolicy:
        policy = PlannerPolicy(
            dish.world, self._player, self._options, anytime=dish.anytime, start=dish.state(state)
        )
        if self._met is not None:
            policy.meet(*self._met)
        for heard in self._heard:
            policy.hear(*heard)
        return policy

    # Events

    def observe(self, did: Did) -> None:
        if self._policy is not None and self._dish is not None:
            own = self._dish.own_action
            self._policy.observe([(player, own(a), applied) for player, a, applied in did])

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        self._met = dict(kinds), clock
        if self._policy is not None:
            self._policy.meet(kinds, clock)

    def hear(self, player: str, speech: Speech) -> None:
        # Requests are for the moment. Only what bots tell each other counts for the next order.
        if speech.to_bots and (player, speech) not in self._heard:
            self._heard = [*self._heard[-MAX_HEARD:], (player, speech)]
        if self._policy is not None:
            self._policy.hear(player, speech)

    def speak(self) -> list[Speech]:
        """Return new messages; the policy of a later order may repeat earlier ones."""
        said = [] if self._policy is None else self._policy.speak()
        # A shift has no goal. The next order may be possible.
        new = [s for s in said if s not in self._spoken and s.text != no_plan_text()]
        self._spoken.update(speech for speech in new if speech.to_bots)
        return new


def play_shift(
    world: World, seed: int = 0, *, watch: Callable[[State], None] = lambda state: None
) -> tuple[Plan, State]:
    """Return the actions of planner bots in all seats of a shift in lockstep, and the last state.

    Args:
        watch: Function that is called with the state after each step.
    """
    rules, dishes = rules_of(world), dict[str, DishPlanner]()
    bots = {
        player: ShiftPolicy(world, player, PlannerOptions(seed=seed), dishes=dishes)
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
