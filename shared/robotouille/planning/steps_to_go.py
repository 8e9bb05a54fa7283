"""Steps to go: how far from the goal the states of an episode are.

distance = StepsToGo(world)
before = None
for state in episode:
    left = distance(state, Limits(expansions=2000), after=before)
    before = state

The Robotouille paper measures how far an episode that failed came by its normalized steps to go:
the fewest steps from its last state to the goal, divided by the fewest from its first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from robotouille.domain.task import Timing
from robotouille.planning import solvers as optimal
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import UNLIMITED, Limits, SearchResult
from robotouille.world.world import State, World

__all__ = ["Range", "StepsLeft", "StepsToGo", "quotient"]


@dataclass(frozen=True, slots=True)
class StepsLeft:
    """What is known of the fewest steps from a state to the goal.

    There are at least `bound` and at most `steps` (None: no plan is known). `dead` says that it is
    proven that no plan reaches the goal; there are no numbers then.
    """

    steps: int | None
    bound: int = 0
    dead: bool = False

    @property
    def exact(self) -> bool:
        """Whether there is nothing left to be found out."""
        return self.dead or self.steps == self.bound


DEAD = StepsLeft(None, dead=True)


@dataclass(frozen=True, slots=True)
class Range:
    """A number that is at least `least` and at most `most` (None: nobody knows)."""

    least: float
    most: float | None


def quotient(above: StepsLeft, below: StepsLeft) -> Range | None:
    """One distance by another, as far as they are known; None if the goal is out of reach."""
    if above.dead or below.dead:
        return None
    if below.steps == 0:
        return None
    least = 0.0 if below.steps is None else above.bound / below.steps
    most = None if above.steps is None or not below.bound else above.steps / below.bound
    return Range(least, most)


class StepsToGo:
    """The fewest steps from any state of a world to the goal, all players acting together.

    What is found out about a state is kept, also about those along its plan: a plan's rest is a
    plan, and where it is proven to be shortest, so is its rest.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._known: dict[State, StepsLeft] = {}
        self._searched: dict[State, Limits] = {}
        alone = len(world.players) == 1
        plain = world.task.timing is Timing.BENCHMARK
        self._anytime = AnytimePlanner(world) if alone and plain else None

    def __call__(
        self, state: State, limits: Limits = UNLIMITED, *, after: State | None = None
    ) -> StepsLeft:
        """The steps from a state, as far as the limits allow a search for them.

        Args:
            after: A state from which one step led to it, if one is known: a step brings the goal
                nearer by one at most, and never back into reach.

        Raises:
            ValueError: The state is of another world.
            PluginError: An installed plug-in is needed and cannot be loaded.
        """
        known = self.known(state, after=after)
        if known.exact:
            return known
        if self._searched.get(state) != limits:  # Whoever stands and waits is where they were.
            self._search(state, known, limits)
            self._searched[state] = limits
        return self._known[state]

    def known(self, state: State, *, after: State | None = None) -> StepsLeft:
        """What is known of the steps from a state without a search; see the call.

        Raises:
            ValueError: The state is of another world.
        """
        if state.world is not self._world:
            raise ValueError("the state is of another world")
        return StepsLeft(0) if state.goal_reached else self._after(state, after)

    def _after(self, state: State, after: State | None) -> StepsLeft:
        """What follows from what is known of the state and of the one before."""
        before = self._known.get(after) if after is not None else None
        if before is None:
            return self._note(state, StepsLeft(None, 1))
        if before.dead:
            return self._note(state, DEAD)
        return self._note(state, StepsLeft(None, max(1, before.bound - 1)))

    def _search(self, state: State, known: StepsLeft, limits: Limits) -> None:
        if self._anytime is None:
            self._record(state, optimal.solve(self._world, state, limits=limits))
            return
        for result in self._anytime.search(state, limits, beam=0):
            known = self._record(state, result)
            if known.exact:
                return

    def _record(self, state: State, result: SearchResult) -> StepsLeft:
        """Keep what a result says about a state, and about those along its plan."""
        if result.unsolvable:
            return self._note(state, DEAD)
        known = self._note(state, StepsLeft(None, result.bound))
        if result.plan is not None:
            self._along(state, result.plan, known.bound)
        return self._known[state]

    def _along(self, state: State, plan: Plan, bound: int) -> None:
        steps = len(plan)
        self._note(state, StepsLeft(steps, bound))
        for joint in plan:
            state, steps, bound = state.step(joint).state, steps - 1, bound - 1
            if steps:
                self._note(state, StepsLeft(steps, max(1, bound)))

    def _note(self, state: State, new: StepsLeft) -> StepsLeft:
        old = self._known.get(state)
        if old is None or new.dead:
            self._known[state] = new
            return new
        if old.dead:
            return old
        steps = min((s for s in (old.steps, new.steps) if s is not None), default=None)
        both = replace(old, steps=steps, bound=max(old.bound, new.bound))
        self._known[state] = both
        return both
