"""Steps to go from each state of a recording to the goal."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque
from collections.abc import Iterator
from typing import Protocol

from robotouille.certification.certificate import Deadline
from robotouille.planning.errands import ErrandList, PlanTrace, errands
from robotouille.planning.plan import Limits
from robotouille.planning.plan_repair import PlanRepair
from robotouille.planning.solvers import AnytimePlanner
from robotouille.planning.steps_to_go import StepsLeft, StepsToGo
from robotouille.world.world import State, World


class StateSource(Protocol):
    """Source of states, such as a `Recording`."""

    @property
    def world(self) -> World:
        """A world of the task that was played."""
        ...

    def states(self) -> Iterator[tuple[int, State]]:
        """Yield the initial state (step 0) and the state after each step."""
        ...


NO_SEARCH = Limits(expansions=0)
MAX_STATES = 50_000
"""States in memory. Of a longer recording, `estimates` skips steps at equal intervals."""


def distances(recording: StateSource, expansions: int, deadline: Deadline) -> Iterator[StepsLeft]:
    """Yield the steps to go at step 0 and after each step.

    Args:
        expansions: Search budget for each state.
        deadline: Returns True when the time is up. The remaining states then get bounds only.

    Raises:
        RecordingError: The task has no such action.
        PluginError: A required plug-in cannot be loaded.
    """
    limits = Limits(expansions, stop=deadline)
    anytime = AnytimePlanner(recording.world)
    distance, before = StepsToGo(anytime.model), None
    for _, recorded in recording.states():
        state = anytime.in_model(recorded)
        if deadline():
            yield distance.known(state, after=before)
        else:
            yield distance(state, limits, after=before)
        before = state if anytime.model is recording.world else None


def estimates(
    recording: StateSource, expansions: int, deadline: Deadline
) -> Iterator[tuple[int, StepsLeft]]:
    """Yield quick estimates of the steps to go, in coarse-to-fine order of the steps.

    Each step is yielded twice: first with the length of some plan, then with a proven lower bound.
    No search for a shortest plan is made, so a viewer can show the whole episode after seconds.

    Args:
        expansions: Search budget for one plan.
        deadline: Returns True when the time is up, which ends the iteration.

    Raises:
        RecordingError: The task has no such action.
        PluginError: A required plug-in cannot be loaded.
    """
    anytime, limits = AnytimePlanner(recording.world), Limits(expansions, stop=deadline)
    states, interval = _thinned(recording)
    states = [anytime.in_model(state) for state in states]
    order = list(coarse_first(len(states)))
    plans = _PlansNearby(anytime, limits)
    for step in order:
        if deadline():
            return
        yield step * interval, plans.left(step, states[step])
    distance = StepsToGo(anytime.model)
    for step in order:
        if deadline():
            return
        yield step * interval, distance(states[step], NO_SEARCH)


def _thinned(recording: StateSource) -> tuple[list[State], int]:
    """Return the states of a recording at equal intervals of steps, and the interval."""
    states: list[State] = []
    interval = 1
    for step, (_, state) in enumerate(recording.states()):
        if step % interval:
            continue
        states.append(state)
        if len(states) > MAX_STATES:
            del states[1::2]
            interval *= 2
    return states, interval


def coarse_first(count: int) -> Iterator[int]:
    """Yield the numbers below a count: both ends, then the middles of the gaps, and so on."""
    yield from dict.fromkeys((0, count - 1)) if count > 0 else ()
    gaps = deque([(0, count - 1)])
    while gaps:
        low, high = gaps.popleft()
        middle = (low + high) // 2
        if low < middle < high:
            yield middle
            gaps += ((low, middle), (middle, high))


class _PlansNearby:
    """Plans for some steps of an episode.

    Repairing the plan of a nearby step is much cheaper than planning, so a new plan is made only
    if neither neighbour's plan can be carried out.
    """

    def __init__(self, anytime: AnytimePlanner, limits: Limits) -> None:
        self._anytime = anytime
        self._limits = limits
        self._repair = PlanRepair(anytime.model)
        self._steps: list[int] = []
        self._plans: dict[int, ErrandList] = {}

    def left(self, step: int, state: State) -> StepsLeft:
        """Return the length of a plan from the state at a step."""
        if state.goal_reached:
            return StepsLeft(0)
        course = self._carried_out(step, state)
        if course is None:
            plan = self._anytime.first(state, self._limits).plan
            course = None if plan is None else PlanTrace.of(plan, state)
        if course is None:
            return StepsLeft(None, 1)
        insort(self._steps, step)
        self._plans[step] = errands(course)
        return StepsLeft(len(course.joints), 1)

    def _carried_out(self, step: int, state: State) -> PlanTrace | None:
        place = bisect_left(self._steps, step)
        around = self._steps[max(0, place - 1) : place + 1]
        found = (self._repair.repair(self._plans[near], state) for near in around)
        courses = [course for course in found if course is not None]
        return min(courses, key=lambda course: len(course.joints), default=None)
