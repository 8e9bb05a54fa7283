"""Steps to go: the distance from states of an episode to the goal.

    distance = StepsToGo(world)
    before = None
    for state in episode:
        left = distance(state, Limits(expansions=2000), after=before)
        before = state

The Robotouille paper measures failed episodes by their normalized steps to go: the fewest steps
from the last state to the goal, divided by the fewest from the first state.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from robotouille.domain.task import Task, TimingProfile
from robotouille.planning.errands import ErrandList, PlanTrace, errands
from robotouille.planning.plan import UNLIMITED, Limits, Plan, SearchResult, replay
from robotouille.planning.plan_repair import PlanRepair
from robotouille.planning.plugins import domain_planner
from robotouille.planning.solvers import AnytimePlanner, solve
from robotouille.world.timers import Timers
from robotouille.world.world import State, World


@dataclass(frozen=True, slots=True)
class StepsLeft:
    """Bounds on the fewest steps from a state to the goal.

    There are at least `bound` and at most `steps` (None: no plan is known). `dead` means that a
    proof shows that no plan exists; then there are no numbers.
    """

    steps: int | None
    bound: int = 0
    dead: bool = False

    @property
    def exact(self) -> bool:
        """True if the number of steps is known exactly."""
        return self.dead or self.steps == self.bound


DEAD = StepsLeft(None, dead=True)

NO_SEARCH = Limits(expansions=0)


@dataclass(frozen=True, slots=True)
class Range:
    """A number between `least` and `most` (None: unknown)."""

    least: float
    most: float | None


def quotient(above: StepsLeft, below: StepsLeft) -> Range | None:
    """Return one distance divided by another as a range, or None if the goal is out of reach."""
    if above.dead or below.dead:
        return None
    if below.steps == 0:
        return None
    least = 0.0 if below.steps is None else above.bound / below.steps
    most = None if above.steps is None or not below.bound else above.steps / below.bound
    return Range(least, most)


Key = tuple[int, Timers]
"""A state of one world: its facts and timers. Equal timers are the same object."""


def _key(state: State) -> Key:
    return state.facts, state.timers


class _WithoutWalks(Task):
    """Task in which walks and repeated work take one step, with the delays of its timing."""

    @property
    def profile(self) -> TimingProfile:
        return replace(super().profile, steps_per_tile=0, repeat_steps=1)


class StepsToGo:
    """The fewest steps from any state of a world to the goal, with all players acting together.

    Results are stored for a state and for the states along its plan: a plan's rest is a plan, and
    the rest of a shortest plan is a shortest one. From a state off all plans, the last plan is
    repaired (`PlanRepair`). The result is a plan, but not necessarily a shortest one. So earlier
    calls never change an exact result, but may narrow a range. Equal calls in equal order give
    equal results on every machine.

    If walks take several steps, a kitchen's steps are bounded in two ways. The lower bound lets
    walks take one step, since in a kitchen an earlier effect never hurts. The upper bound is a plan
    for such walks, executed with all delays. Such a world is searched itself only without a limit
    on expansions.
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
        """Return the steps from a state, searching within the limits.

        Without expansions, the result consists of bounds and repairs of known plans.

        Args:
            after: A state one step before, if known. One step brings the goal at most one step
                nearer, and never back into reach.

        Raises:
            ValueError: The state is of another world.
            PluginError: An installed plug-in is needed and cannot be loaded.
        """
        known = self.known(state, after=after)
        if known.exact:
            return known
        # Waiting returns to a state that was searched with the same limits.
        if self._searched.get(_key(state)) != limits:
            self._find_out(state, limits, after)
            self._searched[_key(state)] = limits
        return self._known[_key(state)]

    def learn(self, start: State, plan: Plan, bound: int = 0) -> StepsLeft:
        """Store a plan from a state, with a lower bound on the length of every plan.

        The state may be one of the same task with another timing. Then the bound is ignored.

        Returns:
            The known bounds on the steps from the state.

        Raises:
            ValueError: The plan does not reach the goal from there.
        """
        report = replay(plan, start.world, start)
        if not report.ok:
            raise ValueError(f"the plan does not reach the goal from the state: {report}")
        if start.world is self._world:
            self.known(start)
            self._along(PlanTrace.of(plan, start), bound)
            return self._known[_key(start)]
        own = self._of(start)
        self.known(own)
        self._try(own, errands(PlanTrace.of(plan, start)))
        return self._known[_key(own)]

    def known(self, state: State, *, after: State | None = None) -> StepsLeft:
        """Return the known bounds on the steps from a state without a search.

        Raises:
            ValueError: The state is of another world.
        """
        if state.world is not self._world:
            raise ValueError("the state is of another world")
        return StepsLeft(0) if state.goal_reached else self._after(state, after)

    def _after(self, state: State, after: State | None) -> StepsLeft:
        """Return the bounds that follow from the state before."""
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
            self._record(state, solve(self._world, state, limits=NO_SEARCH))
        if searches and not self._known[_key(state)].exact:
            self._search(state, limits)

    def _settled(self, state: State) -> bool:
        """Return whether a plan is known, or a proof that no plan exists."""
        known = self._known[_key(state)]
        return known.dead or known.steps is not None

    def _relax(self, relaxed: StepsToGo, state: State, after: State | None) -> None:
        """Store a lower bound from the steps left without walks."""
        before = None if after is None else relaxed._of(after)
        left = relaxed(relaxed._of(state), NO_SEARCH, after=before)
        self._note(state, DEAD if left.dead else StepsLeft(None, left.bound))

    def _find_any(self, relaxed: StepsToGo, state: State, limits: Limits) -> None:
        """Execute a plan that is good without walks; if that fails, one without delays."""
        for planner, start in ((relaxed._anytime, relaxed._of(state)), (self._plain, state)):
            if planner is not None and not self._settled(state):
                easier = planner.in_model(start)
                plan = planner.first(easier, limits).plan
                if plan is not None:
                    self._try(state, errands(PlanTrace.of(plan, easier)))

    def _of(self, state: State) -> State:
        """Return a state of another timing as a state of this world in which nobody is busy."""
        return self._world.restore(state.facts, state.timer_rows())

    def _carry_out(self, state: State, after: State | None) -> None:
        """Execute known plans: the plan of the state before, and the first and last ones."""
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
            self._record(state, solve(self._world, state, limits=limits))
            return
        for result in self._anytime.search(state, limits, beam=0):
            known = self._record(state, result)
            if known.exact:
                return

    def _record(self, state: State, result: SearchResult) -> StepsLeft:
        """Store a result for a state and for the states along its plan."""
        if result.unsolvable:
            return self._note(state, DEAD)
        known = self._note(state, StepsLeft(None, result.bound))
        if result.plan is not None:
            self._along(PlanTrace.of(result.plan, state), known.bound)
        return self._known[_key(state)]

    def _along(self, course: PlanTrace, bound: int) -> None:
        """Store a plan, its rests, and a lower bound on the length of every plan."""
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
