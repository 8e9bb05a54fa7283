"""How far from the goal each state of a recording is."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque
from collections.abc import Iterator
from typing import Protocol

from robotouille.certification.certificate import Deadline
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.repair.errands import Course, ErrandList, errands
from robotouille.planning.repair.plan_repair import PlanRepair
from robotouille.planning.search_result import Limits
from robotouille.planning.steps_to_go import StepsLeft, StepsToGo
from robotouille.world.world import State, World

__all__ = ["StateSource", "coarse_first", "distances", "estimates"]


class StateSource(Protocol):
    """What has states: a `Recording`."""

    @property
    def world(self) -> World:
        """A world of the task that was played."""
        ...

    def states(self) -> Iterator[tuple[int, State]]:
        """The state at step 0 and after each step."""
        ...


NO_SEARCH = Limits(expansions=0)


def distances(recording: StateSource, expansions: int, deadline: Deadline) -> Iterator[StepsLeft]:
    """The steps to go at step 0 and after each step, in the model of the recording's world.

    Args:
        expansions: What the search from one state may cost.
        deadline: When it has struck, nothing more is searched, and of the rest only bounds come.

    Raises:
        RecordingError: A step has an action that the task has not.
        PluginError: An installed plug-in is needed and cannot be loaded.
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
    """Steps and what is known of them, without a search for what is shortest, until all is told or
    the deadline strikes: the first and the last step, the one in the middle, the middles of both
    halves, and so on; first how many steps are enough, by plans that are carried out from where
    another one was made, then again with what is proven to be missing.

    Args:
        expansions: What a plan may cost.
        deadline: When it has struck, there is nothing more.

    Raises:
        RecordingError: A step has an action that the task has not.
        PluginError: An installed plug-in is needed and cannot be loaded.
    """
    anytime, limits = AnytimePlanner(recording.world), Limits(expansions, stop=deadline)
    states = [anytime.in_model(state) for _, state in recording.states()]
    order = list(coarse_first(len(states)))
    plans = _PlansNearby(anytime, limits)
    for step in order:
        if deadline():
            return
        yield step, plans.left(step, states[step])
    distance = StepsToGo(anytime.model)
    for step in order:
        if deadline():
            return
        yield step, distance(states[step], NO_SEARCH)


def coarse_first(count: int) -> Iterator[int]:
    """The numbers below a count: the ends, then the middles of what is left between two."""
    yield from dict.fromkeys((0, count - 1)) if count > 0 else ()
    gaps = deque([(0, count - 1)])
    while gaps:
        low, high = gaps.popleft()
        middle = (low + high) // 2
        if low < middle < high:
            yield middle
            gaps += ((low, middle), (middle, high))


class _PlansNearby:
    """Plans from some steps of an episode on: a new one is made where none of those that were found
    for the steps around it can be carried out."""

    def __init__(self, anytime: AnytimePlanner, limits: Limits) -> None:
        self._anytime = anytime
        self._limits = limits
        self._repair = PlanRepair(anytime.model)
        self._steps: list[int] = []
        self._plans: dict[int, ErrandList] = {}

    def left(self, step: int, state: State) -> StepsLeft:
        """How many steps are enough from the state at a step."""
        if state.goal_reached:
            return StepsLeft(0)
        course = self._carried_out(step, state)
        if course is None:
            plan = self._anytime.first(state, self._limits).plan
            course = None if plan is None else Course.of(plan, state)
        if course is None:
            return StepsLeft(None, 1)
        insort(self._steps, step)
        self._plans[step] = errands(course)
        return StepsLeft(len(course.joints), 1)

    def _carried_out(self, step: int, state: State) -> Course | None:
        """The shorter of what becomes of the plans before and after a step."""
        place = bisect_left(self._steps, step)
        around = self._steps[max(0, place - 1) : place + 1]
        found = (self._repair.repair(self._plans[near], state) for near in around)
        courses = [course for course in found if course is not None]
        return min(courses, key=lambda course: len(course.joints), default=None)
