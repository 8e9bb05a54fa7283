"""A seat that plans for itself: alone, or with others that plan alike.

Planners in several seats make the same plan from the same state, each for the whole team, and each
plays its own part: they work together without a word. A seat that does something else, or keeps the
others waiting, is no longer counted on; those that are left plan around it, anew whenever it gets
in their way.
"""

from __future__ import annotations

import random
from math import ceil

from robotouille.domain.task import Task, Timing
from robotouille.planning.planner import Planner
from robotouille.planning.script import Did, Script
from robotouille.world.actions import GroundAction
from robotouille.world.state import State
from robotouille.world.world import World

__all__ = ["PlannerPolicy"]

EXPANSIONS = 2_000
PATIENCE = 4
"""Decisions that a seat waits in vain before it plans anew."""


class PlannerPolicy:
    """Chooses the actions of one seat by search on its own copy of the world.

    One seed, one course: nothing here reads a clock.
    """

    def __init__(
        self, world: World, player: str, *, seed: int = 0, expansions: int = EXPANSIONS
    ) -> None:
        self._player = player
        self._seed = seed
        self._expansions = expansions
        self._random = random.Random(f"{seed}:{player}")
        self._team = set(world.players)
        self._model = World(_without_waiting(world.task))
        self._planner = Planner(self._model)
        self._script: Script | None = None
        self._waited = 0
        self._failures = 0

    def observe(self, did: Did) -> None:
        """What everybody did in a step; called once for each step before `act`."""
        if self._script is None:
            return
        self._script.observe(did)
        strangers = (self._script.astray & self._team) - {self._player}
        if strangers or self._player in self._script.astray:
            self._team -= strangers
            self._script = None

    def act(self, state: State) -> GroundAction | None:
        """The action to take in a state; None to do nothing this step."""
        if state.goal_reached or state.busy_steps(self._player):
            return None
        if self._script is None:
            self._plan(state)
        action = self._script.act(state) if self._script is not None else None
        if action is not None:
            self._waited = 0
            return action
        return self._wait(state)

    def _plan(self, state: State) -> None:
        start = _in_model(state, self._model)
        solution = self._planner.solve(
            start, tuple(sorted(self._team)), seed=self._seed, expansions=self._expansions
        )
        self._failures = 0 if solution.reached else self._failures + 1
        self._script = Script(self._player, solution.plan, start)
        self._waited = 0

    def _wait(self, state: State) -> GroundAction | None:
        """Nothing to do now: be patient, but neither for ever nor in others' way."""
        self._waited += 1
        if self._waited <= PATIENCE or self._somebody_is_busy(state):
            return None
        script, self._script, self._waited = self._script, None, 0
        if script is not None:
            self._team -= set(script.waits_for())
        helpless = script is None or script.finished or self._failures > 0
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


def _without_waiting(task: Task) -> Task:
    """The same task with the shortest delays: a plan is an order of actions, under any timing."""
    return Task(task.name, task.domain, task.problem, task.seats, Timing.BENCHMARK, task.source)


def _in_model(state: State, model: World) -> State:
    """A state of another timing profile as a state of the model: what is left of a delay there
    is left of it here, in the model's shorter steps."""
    if state.world.task.timing is Timing.BENCHMARK:
        return model.restore(state.facts, state.timer_rows())
    factor = state.world.task.profile.delay_factor
    rows = []
    for effect, progress in state.timers.entries:
        counters = list(progress)
        for node in effect.counters():
            if node.kind == "delayed" and 0 <= counters[node.slot] < node.total:
                total = (node.total - 1) // factor + 1
                left = ceil((node.total - counters[node.slot]) / factor)
                counters[node.slot] = max(0, total - left)
        rows.append((*effect.label, tuple(counters)))
    return model.restore(state.facts, rows)
