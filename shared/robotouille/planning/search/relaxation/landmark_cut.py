"""LM-cut: a lower bound on the actions of a plan, from disjoint sets one of which each plan needs.

M. Helmert, C. Domshlak: Landmarks, Critical Paths and Abstractions: What's the Difference Anyway?
ICAPS 2009. In the relaxed task, let every operator depend only on its dearest precondition. Any
way to the goal crosses the border of the region from which the goal costs nothing more: the
operators that cross it are a *cut*. Count 1 for the cut, make its operators free, and repeat until
the goal is free.

Costs are 0 and 1, so that distances are levels of a breadth-first search; after a cut they only
fall, and only where they fall they are computed anew.
"""

from __future__ import annotations

import math

from robotouille.planning.search.relaxation.relaxed_task import RelaxedTask

__all__ = ["landmark_cut"]

FAR = 1 << 30


def landmark_cut(task: RelaxedTask, props: list[int]) -> float:
    """A lower bound on the number of actions from a state; infinite if there is no way."""
    distances = _Distances(task, props)
    cuts = 0
    while 0 < distances.of[task.goal] < FAR:
        distances.make_free(_cut(task, props, distances))
        cuts += 1
    return cuts if distances.of[task.goal] < FAR else math.inf


class _Distances:
    """The cost of each proposition, where only an operator's dearest precondition counts (h^max).

    `hardest` is for each operator a precondition that costs most, -1 where one cannot be reached;
    `followers` has for each proposition the operators whose hardest precondition it is, or was.
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
    """The operators that lead into the region from which the goal costs nothing more."""
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
    """The propositions from which free operators lead to the goal."""
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
