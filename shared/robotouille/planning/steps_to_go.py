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

from robotouille.domain.task import Task, TimingProfile
from robotouille.planning import solvers as optimal
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.plan import Plan
from robotouille.planning.plugins import domain_planner
from robotouille.planning.repair.errands import Course, ErrandList, errands
from robotouille.planning.repair.plan_repair import PlanRepair
from robotouille.planning.search_result import UNLIMITED, Limits, SearchResult
from robotouille.planning.validation import replay
from robotouille.world.timers import Timers
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

NO_SEARCH = Limits(expansions=0)


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


Key = tuple[int, Timers]
"""A state of one world: its facts, and its timers, which are one object where they are equal."""


def _key(state: State) -> Key:
    return state.facts, state.timers


class _WithoutWalks(Task):
    """A task in which walking and repeated work take a step; delays are those of its timing."""

    @property
    def profile(self) -> TimingProfile:
        return replace(super().profile, steps_per_tile=0, repeat_steps=1)


class StepsToGo:
    """The fewest steps from any state of a world to the goal, all players acting together.

    What is found out about a state is kept, also about those along its plan: a plan's rest is a
    plan, and where it is proven to be shortest, so is its rest. From a state off all plans the last
    plan is carried out as far as it makes sense (`PlanRepair`), which is a plan again, if no
    shortest one. So an answer that is exact is so whatever was asked before; one that is a range
    may be narrower for it. The same questions in the same order have the same answers everywhere.

    Where walks take as long as they are, a kitchen's steps are bounded: from below by what is left
    if they took a step each, since in a kitchen nothing is lost by what comes sooner; from above by
    a plan for that, carried out with all delays. Such a world is searched itself only if the limits
    allow any number of expansions.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._known: dict[Key, StepsLeft] = {}
        self._searched: dict[Key, Limits] = {}
        self._plans: dict[Key, ErrandList] = {}
        self._latest: list[Key] = []
        self._repair = PlanRepair(world)
        alone, profile = len(world.players) == 1, world.task.profile
        walks = bool(profile.steps_per_tile or profile.repeat_steps > 1)
        self._plain = AnytimePlanner(world)
        self._anytime = self._plain if alone and not walks else None
        self._relaxed: StepsToGo | None = None
        if walks and domain_planner(world) is not None:
            task = world.task
            fields = (task.name, task.domain, task.problem, task.seats, task.timing, task.source)
            self._relaxed = StepsToGo(World(_WithoutWalks(*fields)))

    def __call__(
        self, state: State, limits: Limits = UNLIMITED, *, after: State | None = None
    ) -> StepsLeft:
        """The steps from a state, as far as the limits allow a search for them.

        Without expansions there is no search, but bounds, and a plan made of a known one, if any.

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
        # Whoever stands and waits is where they were.
        if self._searched.get(_key(state)) != limits:
            self._find_out(state, limits, after)
            self._searched[_key(state)] = limits
        return self._known[_key(state)]

    def learn(self, start: State, plan: Plan, bound: int = 0) -> StepsLeft:
        """Keep a plan from a state, made elsewhere, and a bound that every plan's length reaches.

        The state may be one of the same task with another timing. Then the bound says nothing.

        Returns:
            What is known of the steps from the state.

        Raises:
            ValueError: The plan does not reach the goal from there.
        """
        report = replay(plan, start.world, start)
        if not report.ok:
            raise ValueError(f"this is no plan from that state: {report}")
        if start.world is self._world:
            self.known(start)
            self._along(Course.of(plan, start), bound)
            return self._known[_key(start)]
        own = self._of(start)
        self.known(own)
        self._try(own, errands(Course.of(plan, start)))
        return self._known[_key(own)]

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
        before = self._known.get(_key(after)) if after is not None else None
        if before is None:
            return self._note(state, StepsLeft(None, 1))
        if before.dead:
            return self._note(state, DEAD)
        return self._note(state, StepsLeft(None, max(1, before.bound - 1)))

    def _find_out(self, state: State, limits: Limits, after: State | None) -> None:
        searches, alone = limits != NO_SEARCH, self._anytime is not None
        if self._relaxed is not None:
            self._relax(self._relaxed, state, after)
        if not self._settled(state) and not (alone and searches):
            self._carry_out(state, after)
        if self._relaxed is not None:
            if searches and not self._settled(state):
                self._find_any(self._relaxed, state, limits)
            searches = limits.expansions is None
        elif self._known[_key(state)].steps is not None or not searches:
            self._record(state, optimal.solve(self._world, state, limits=NO_SEARCH))
        if searches and not self._known[_key(state)].exact:
            self._search(state, limits)

    def _settled(self, state: State) -> bool:
        """Whether a plan from a state is known, or that there is none."""
        known = self._known[_key(state)]
        return known.dead or known.steps is not None

    def _relax(self, relaxed: StepsToGo, state: State, after: State | None) -> None:
        """A bound from what is left without walks."""
        before = None if after is None else relaxed._of(after)
        left = relaxed(relaxed._of(state), NO_SEARCH, after=before)
        self._note(state, DEAD if left.dead else StepsLeft(None, left.bound))

    def _find_any(self, relaxed: StepsToGo, state: State, limits: Limits) -> None:
        """Carry out a plan that is good without walks, and if that fails without delays."""
        for planner, start in ((relaxed._anytime, relaxed._of(state)), (self._plain, state)):
            if planner is not None and not self._settled(state):
                easier = planner.in_model(start)
                plan = planner.first(easier, limits).plan
                if plan is not None:
                    self._try(state, errands(Course.of(plan, easier)))

    def _of(self, state: State) -> State:
        """A state of the same task with another timing as one of this world, nobody busy."""
        return self._world.restore(state.facts, state.timer_rows())

    def _carry_out(self, state: State, after: State | None) -> None:
        """Carry out known plans from here: that of the state before, and the first and last."""
        asked = [_key(after)] if after is not None else []
        plans = [self._plans.get(known) for known in (*asked, *self._latest)]
        for plan in {id(plan): plan for plan in plans if plan is not None}.values():
            if not self._known[_key(state)].exact:
                self._try(state, plan)

    def _try(self, state: State, plan: ErrandList) -> None:
        course = self._repair.repair(plan, state)
        if course is not None:
            self._along(course, self._known[_key(state)].bound)

    def _search(self, state: State, limits: Limits) -> None:
        if self._anytime is None or self._known[_key(state)].steps is not None:
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
            self._along(Course.of(result.plan, state), known.bound)
        return self._known[_key(state)]

    def _along(self, course: Course, bound: int) -> None:
        """Keep a plan, its rests, and a bound that every plan's length reaches."""
        plan = errands(course)
        self._latest = [*self._latest[:1], _key(course.states[0])]
        for number, state in enumerate(course.states[:-1]):
            steps = len(course.joints) - number
            before = self._known.get(_key(state))
            if before is None or before.steps is None or steps < before.steps:
                self._plans[_key(state)] = plan
            self._note(state, StepsLeft(steps, max(1, bound - number)))

    def _note(self, state: State, new: StepsLeft) -> StepsLeft:
        old = self._known.get(_key(state))
        if old is None or new.dead:
            self._known[_key(state)] = new
            return new
        if old.dead:
            return old
        steps = min((s for s in (old.steps, new.steps) if s is not None), default=None)
        both = replace(old, steps=steps, bound=max(old.bound, new.bound))
        self._known[_key(state)] = both
        return both
