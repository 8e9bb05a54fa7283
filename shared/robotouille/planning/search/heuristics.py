"""Admissible heuristics of A*: lower bounds on the steps to the goal.

Kitchens have their own heuristic (`planning/kitchen/bound`), and so has the beam search
(`planning/beam/remaining_work_heuristic.py`).
"""

from __future__ import annotations

import math
from heapq import heappop, heappush
from typing import Protocol

from robotouille.planning.search.relaxed_operators import TooLargeError
from robotouille.planning.search.relaxed_task import Relaxation, RelaxedState, RelaxedTask
from robotouille.world.timers import Timers
from robotouille.world.world import State, World


def critical_path(task: RelaxedTask, relaxed_state: RelaxedState, players: int) -> float:
    """Return a lower bound on the steps to the goal; infinite if it is unreachable."""
    unmet = task.counts.copy()
    time = dict.fromkeys(relaxed_state.props, 0)
    queue = [(0, prop) for prop in time]
    settled = bytearray(task.size)
    while queue:
        now, prop = heappop(queue)
        if prop == task.goal:
            return math.ceil(now / players)
        if settled[prop]:
            continue
        settled[prop] = 1
        for operator in task.precondition_of[prop]:
            unmet[operator] -= 1
            if unmet[operator]:
                continue
            after = now + task.cost[operator]
            if task.timed[operator]:
                delay = relaxed_state.left.get(operator, task.delay[operator])
                after = (max(-(-now // players), 1) + delay) * players
            for added in task.add_effects[operator]:
                if after < time.get(added, math.inf):
                    time[added] = after
                    heappush(queue, (after, added))
    return math.inf


FAR = 1 << 30


def landmark_cut(task: RelaxedTask, props: list[int]) -> float:
    """Return a lower bound on the actions to the goal; infinite if it is unreachable."""
    distances = _Distances(task, props)
    cuts = 0
    while 0 < distances.of[task.goal] < FAR:
        distances.make_free(_cut(task, props, distances))
        cuts += 1
    return cuts if distances.of[task.goal] < FAR else math.inf


class _Distances:
    """Costs of propositions if only an operator's most expensive precondition counts (h^max).

    `hardest` contains for each operator a most expensive precondition, or -1 if one is unreachable.
    `followers` contains for each proposition the operators whose hardest precondition it is or was.
    """

    def __init__(self, task: RelaxedTask, props: list[int]) -> None:
        self._task = task
        self.cost = bytearray(task.cost)
        self.of = [FAR] * task.size
        self.hardest = [-1] * len(task.preconditions)
        self.followers: list[list[int]] = [[] for _ in range(task.size)]
        self._explore(props)

    def _explore(self, props: list[int]) -> None:
        task, of, hardest, cost = self._task, self.of, self.hardest, self.cost
        precondition_of, add_effects, followers = (
            task.precondition_of,
            task.add_effects,
            self.followers,
        )
        unmet = task.counts.copy()
        level = 0
        for prop in props:
            of[prop] = 0
        frontier = props.copy()
        following: list[int] = []
        while frontier:
            while frontier:
                prop = frontier.pop()
                if of[prop] < level:
                    continue
                for operator in precondition_of[prop]:
                    unmet[operator] -= 1
                    if unmet[operator]:
                        continue
                    hardest[operator] = prop
                    followers[prop].append(operator)
                    then, front = (level + 1, following) if cost[operator] else (level, frontier)
                    for added in add_effects[operator]:
                        if then < of[added]:
                            of[added] = then
                            front.append(added)
            level += 1
            frontier, following = following, []

    def make_free(self, cut: list[int]) -> None:
        """Let the operators of a cut cost nothing, and correct what costs less now."""
        task, of, hardest, cost = self._task, self.of, self.hardest, self.cost
        followers, add_effects, preconditions = self.followers, task.add_effects, task.preconditions
        fallen: list[list[int]] = [[] for _ in range(of[task.goal] + 1)]
        deepest = len(fallen) - 1
        for operator in cut:
            cost[operator] = 0
            now = of[hardest[operator]]
            for added in add_effects[operator]:
                if now < of[added]:
                    of[added] = now
                    if now <= deepest:
                        fallen[now].append(added)
        for level, frontier in enumerate(fallen):
            while frontier:
                prop = frontier.pop()
                if of[prop] != level:
                    continue
                followed, followers[prop] = followers[prop], []
                for operator in followed:
                    if hardest[operator] != prop:
                        continue
                    dearest, now = prop, level
                    for need in preconditions[operator]:
                        if of[need] > now:
                            dearest, now = need, of[need]
                    hardest[operator] = dearest
                    followers[dearest].append(operator)
                    now += cost[operator]
                    for added in add_effects[operator]:
                        if now < of[added]:
                            of[added] = now
                            if now <= deepest:
                                fallen[now].append(added)


def _cut(task: RelaxedTask, props: list[int], distances: _Distances) -> list[int]:
    """Return the operators that lead into the region from which the goal costs nothing more."""
    add_effects, followers, hardest = task.add_effects, distances.followers, distances.hardest
    near = _free_of_charge(task, distances)
    seen = bytearray(task.size)
    for prop in props:
        seen[prop] = 1
    frontier = props.copy()
    cut = []
    while frontier:
        prop = frontier.pop()
        for operator in followers[prop]:
            if hardest[operator] != prop:
                continue
            new = []
            for added in add_effects[operator]:
                if near[added]:
                    cut.append(operator)
                    break
                if not seen[added]:
                    new.append(added)
            else:
                for added in new:
                    seen[added] = 1
                frontier += new
    return cut


def _free_of_charge(task: RelaxedTask, distances: _Distances) -> bytearray:
    """Return the propositions from which free operators lead to the goal."""
    achievers, hardest, cost = task.achievers, distances.hardest, distances.cost
    near = bytearray(task.size)
    near[task.goal] = 1
    frontier = [task.goal]
    while frontier:
        for operator in achievers[frontier.pop()]:
            if not cost[operator]:
                need = hardest[operator]
                if need >= 0 and not near[need]:
                    near[need] = 1
                    frontier.append(need)
    return near


class Heuristic(Protocol):
    """A lower bound on the steps from a state to the goal; infinite only if it is unreachable.

    It is never called for goal states.
    """

    def __call__(self, facts: int, timers: Timers) -> float: ...


class Blind:
    """Heuristic that returns 1 for every state."""

    def __call__(self, facts: int, timers: Timers) -> float:
        return 1


BLIND = Blind()


class CriticalPath:
    """Critical path of the relaxed task (`critical_path`), for states reachable from `start`."""

    def __init__(self, world: World, start: State | None = None) -> None:
        self._relaxation = Relaxation(world, world.initial if start is None else start)
        self._players = max(1, len(world.players))

    def __call__(self, facts: int, timers: Timers) -> float:
        task = self._relaxation.task(facts, timers)
        return critical_path(task, task.relaxed_state(facts, timers), self._players)


class LandmarkCut:
    """The larger of the critical path and the steps that LM-cut's number of actions takes.

    It applies to states reachable from `start`, by default the initial state. It is 1 for states
    with so many created objects that a relaxation would be too large.
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
    """Return LM-cut, or the blind heuristic if a relaxation of the start would be too large."""
    try:
        return LandmarkCut(world, start)
    except TooLargeError:
        return BLIND


def _steps_for(actions: int, timers: Timers, players: int) -> int:
    """Return the fewest steps in which the players can take a number of actions."""
    if not actions:
        return 0
    busy = sorted(steps for _, steps in timers.busy)
    busy = [0] * (players - len(busy)) + busy
    # Each free player takes one action per step. For every number n, the n players who are free
    # first share the actions; a player who is busy too long lowers the total, so the minimum is
    # right.
    return min(-(-(actions + sum(busy[:n])) // n) for n in range(1, players + 1))
