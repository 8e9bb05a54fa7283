"""A seat that plans for itself: alone, or with others that plan alike.

Planners in several seats make the same plan from the same state, each for the whole team, and each
plays its own part: they work together without a word. A seat that does something else, or keeps the
others waiting, is no longer counted on; those that are left plan around it, anew whenever it gets
in their way.
"""

from __future__ import annotations

import random

from robotouille.domain.task import Timing
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.plan import Plan
from robotouille.planning.policies.script import Did, Script
from robotouille.planning.search_result import Limits
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World

__all__ = ["PlannerPolicy"]

EXPANSIONS = 2_000
"""Of the beam search, for each plan of a team."""

ALONE, TOGETHER = Limits(expansions=130), Limits(expansions=500)
"""What may be spent on a decision, or on a plan for two, to find a shorter plan: about 0.1 s for
one player and 0.5 s for two in plain Python."""

PATIENCE = 4
"""Decisions that a seat waits, while nobody does anything, before it plans anew."""


class PlannerPolicy:
    """Chooses the actions of one seat by search on its own copy of the world.

    One seed, one course: nothing here reads a clock. `alone` counts on nobody else from the start,
    which makes decisions quicker; so does an `anytime` of the task that knows it already.
    """

    def __init__(
        self,
        world: World,
        player: str,
        *,
        seed: int = 0,
        expansions: int = EXPANSIONS,
        alone: bool = False,
        anytime: AnytimePlanner | None = None,
    ) -> None:
        self._player = player
        self._seed = seed
        self._expansions = expansions
        self._random = random.Random(f"{seed}:{player}")
        self._team = {player} if alone else set(world.players)
        self._alone = len(self._team) == 1
        self._only = len(world.players) == 1
        self._punctual = world.task.timing is Timing.BENCHMARK
        self._anytime = anytime or AnytimePlanner(World(world.task))
        self._script: Script | None = None
        self._steps_left = 0
        self._may_improve = False
        self._waited = 0
        self._has_plan = True

    @property
    def has_plan(self) -> bool:
        """Whether the last search found a plan. Without one the seat comes as near to the goal as
        it can, and then does nothing but make way for others."""
        return self._has_plan

    def observe(self, did: Did) -> None:
        """What everybody did in a step; called once for each step before `act`."""
        self._steps_left -= 1
        if self._script is None:
            return
        self._script.observe(did)
        astray = (self._script.astray & self._team) - {self._player}
        if astray or self._player in self._script.astray:
            self._team -= astray
            self._script = None
        busy = {player for player, action, applied in did if applied and _does_something(action)}
        if busy & self._team:
            self._waited = 0

    def act(self, state: State) -> GroundAction | None:
        """The action to take in a state; None to do nothing this step."""
        if state.goal_reached or state.busy_steps(self._player):
            return None
        if self._script is None:
            self._plan(state)
        elif self._may_improve:
            self._improve(state)
        action = self._script.act(state) if self._script is not None else None
        if action is not None:
            self._waited = 0
            return action
        return self._wait(state)

    def _plan(self, state: State) -> None:
        team = tuple(sorted(self._team))
        *_, result = self._anytime.search(
            state,
            ALONE if self._alone else TOGETHER,
            team=team,
            seed=self._seed,
            beam=self._expansions,
        )
        self._has_plan = result.plan is not None
        if result.plan is not None:
            self._follow(result.plan, state)
        elif result.unsolvable:
            self._follow(Plan(()), state)
        else:
            plan = self._anytime.towards(state, team=team, seed=self._seed, beam=self._expansions)
            self._follow(plan, state)
        unproven = result.plan is not None and not result.optimal
        self._may_improve = unproven and self._only and self._punctual

    def _improve(self, state: State) -> None:
        """Take what time there is at every decision to look for a shorter plan for the rest.

        Only where steps are those of the plan: elsewhere lengths say little about time. And only
        where there are no other seats, whose parts a shorter plan would count on.
        """
        for result in self._anytime.search(state, ALONE, beam=0):
            if result.plan is not None and len(result.plan) < self._steps_left:
                self._follow(result.plan, state)
            self._may_improve = result.plan is None or self._steps_left > result.bound

    def _follow(self, plan: Plan, state: State) -> None:
        self._script = Script(self._player, plan, self._anytime.in_model(state))
        self._steps_left = len(plan)
        self._waited = 0

    def _wait(self, state: State) -> GroundAction | None:
        """Nothing to do now: be patient, but neither for ever nor in others' way."""
        self._waited += 1
        if self._waited <= PATIENCE or self._somebody_is_busy(state):
            return None
        script, self._script, self._waited = self._script, None, 0
        if script is not None:
            self._team -= set(script.waits_for())
        if self._only:
            return None
        helpless = script is None or script.finished or not self._has_plan
        return self._step_aside(state) if helpless or self._random.random() < 0.25 else None

    def _somebody_is_busy(self, state: State) -> bool:
        """Whether time alone will bring something: a walk ends, a patty is done."""
        if state.timers.busy:
            return True
        return any(row.timed and row.running for row in state.progress())

    def _step_aside(self, state: State) -> GroundAction | None:
        """Walk somewhere else, so as not to stand where somebody wants to be."""
        walks = [a for a in state.actions(self._player) if a.schema.definition.travel]
        return self._random.choice(walks) if walks else None


def _does_something(action: GroundAction) -> bool:
    """Whether an action is more than to wait."""
    return bool(action.touched or action.effects)
