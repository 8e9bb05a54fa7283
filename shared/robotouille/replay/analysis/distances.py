"""How far from the goal each state of a recording is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from robotouille.certification.certificate import Deadline
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.search_result import Limits
from robotouille.planning.steps_to_go import StepsLeft, StepsToGo
from robotouille.world.world import State, World

__all__ = ["StateSource", "distances", "estimates"]


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


def estimates(recording: StateSource, expansions: int, deadline: Deadline) -> Iterator[StepsLeft]:
    """The same as ranges, without a search for what is shortest: a plan from the beginning is
    carried out from each state on; where that fails, another one is made.

    Args:
        expansions: What a plan may cost.
        deadline: When it has struck, no more plans are made.

    Raises:
        RecordingError: A step has an action that the task has not.
        PluginError: An installed plug-in is needed and cannot be loaded.
    """
    limits = Limits(expansions, stop=deadline)
    anytime = AnytimePlanner(recording.world)
    distance, before = StepsToGo(anytime.model), None
    for step, recorded in recording.states():
        state = anytime.in_model(recorded)
        left = distance(state, NO_SEARCH, after=before) if step else distance.known(state)
        if left.steps is None and not left.dead and not deadline():
            plan = anytime.first(state, limits).plan
            if plan is not None:
                distance.learn(state, plan)
            left = distance(state, NO_SEARCH, after=before)
        yield left
        before = state if anytime.model is recording.world else None
