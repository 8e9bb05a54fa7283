"""Admissible heuristics of the steps to the goal: never more than there are.

That of the kitchen solver is in `planners/kitchen/heuristic`, that of the beam search in
`planning/beam/remaining_work_heuristic.py`.
"""

from __future__ import annotations

import math
from typing import Protocol

from robotouille.planning.search.relaxation.critical_path import critical_path
from robotouille.planning.search.relaxation.landmark_cut import landmark_cut
from robotouille.planning.search.relaxation.relaxed_task import Relaxation
from robotouille.planning.search.relaxation.schema_grounding import TooLargeError
from robotouille.world.timers import Timers
from robotouille.world.world import State, World

__all__ = ["BLIND", "Blind", "CriticalPath", "Heuristic", "LandmarkCut", "default_heuristic"]


class Heuristic(Protocol):
    """A lower bound on the steps from a state to the goal; infinite only if there is no way.

    Of a state in which the goal holds it is never asked.
    """

    def __call__(self, facts: int, timers: Timers) -> float: ...


class Blind:
    """Where the goal does not hold, a step is missing."""

    def __call__(self, facts: int, timers: Timers) -> float:
        return 1


BLIND = Blind()


class CriticalPath:
    """The critical path of the relaxed task (`critical_path`), for states reached from `start`."""

    def __init__(self, world: World, start: State | None = None) -> None:
        self._relaxation = Relaxation(world, world.initial if start is None else start)
        self._players = max(1, len(world.players))

    def __call__(self, facts: int, timers: Timers) -> float:
        task = self._relaxation.task(facts, timers)
        return critical_path(task, task.relaxed_state(facts, timers), self._players)


class LandmarkCut:
    """The larger of the critical path and what time the actions that LM-cut counts take.

    For states that can be reached from `start` (the initial state if None); 1 where so much has
    been created that a relaxation would be too large.
    """

    def __init__(self, world: World, start: State | None = None) -> None:
        self._relaxation = Relaxation(world, world.initial if start is None else start)
        self._players = max(1, len(world.players))

    def __call__(self, facts: int, timers: Timers) -> float:
        try:
            task = self._relaxation.task(facts, timers)
        except TooLargeError:
            return 1
        relaxed_state = task.relaxed_state(facts, timers)
        actions = landmark_cut(task, relaxed_state.props)
        if actions == math.inf:
            return math.inf
        steps = critical_path(task, relaxed_state, self._players)
        return max(_steps_for(int(actions), timers, self._players), steps)


def default_heuristic(world: World, start: State) -> Heuristic:
    """LM-cut, or nothing where a relaxation of the start would be too large."""
    try:
        return LandmarkCut(world, start)
    except TooLargeError:
        return BLIND


def _steps_for(actions: int, timers: Timers, players: int) -> int:
    """The steps in which so many actions can be done, one a step by each player who is not busy.

    Of each number of players, those that are free first; with too many of them, the last is
    counted as if it did less than nothing, so that the least of all is right.
    """
    if not actions:
        return 0
    busy = sorted(steps for _, steps in timers.busy)
    busy = [0] * (players - len(busy)) + busy
    return min(-(-(actions + sum(busy[:n])) // n) for n in range(1, players + 1))
