"""LM-cut: a lower bound on the actions of a plan, from disjoint sets one of which each plan needs.

M. Helmert, C. Domshlak: Landmarks, Critical Paths and Abstractions: What's the Difference Anyway?
ICAPS 2009. In the relaxed task, let every rule depend only on its dearest need. Any way to the
goal crosses the border of the region from which the goal costs nothing more: the rules that cross
it are a *cut*. Count 1 for the cut, make its rules free, and repeat until the goal is free.

Costs are 0 and 1, so that distances are levels of a breadth-first search; after a cut they only
fall, and only where they fall they are computed anew.
"""

from __future__ import annotations

import math

from robotouille.planning.search.relaxation.relaxed_task import RelaxedTask

__all__ = ["landmark_cut"]

FAR = 1 << 30


def landmark_cut(task: RelaxedTask, props: list[int]) -> float:
    """A lower bound on the number of actions from a situation; infinite if there is no way."""
    distances = _Distances(task, props)
    cuts = 0
    while 0 < distances.of[task.goal] < FAR:
        distances.make_free(_cut(task, props, distances))
        cuts += 1
    return cuts if distances.of[task.goal] < FAR else math.inf


class _Distances:
    """The cost of each proposition, its needs taken to cost as much as the dearest one (h^max).

    `hardest` is for each rule a need that costs most, -1 where some need cannot be reached;
    `followers` has for each proposition the rules whose hardest need it is, or once was.
    """

    def __init__(self, task: RelaxedTask, props: list[int]) -> None:
        self._task = task
        self.cost = bytearray(task.cost)
        self.of = [FAR] * task.size
        self.hardest = [-1] * len(task.needs)
        self.followers: list[list[int]] = [[] for _ in range(task.size)]
        self._explore(props)

    def _explore(self, props: list[int]) -> None:
        task, of, hardest, cost = self._task, self.of, self.hardest, self.cost
        users, adds, followers = task.users, task.adds, self.followers
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
                for rule in users[prop]:
                    unmet[rule] -= 1
                    if unmet[rule]:
                        continue
                    hardest[rule] = prop
                    followers[prop].append(rule)
                    then, front = (level + 1, following) if cost[rule] else (level, frontier)
                    for added in adds[rule]:
                        if then < of[added]:
                            of[added] = then
                            front.append(added)
            level += 1
            frontier, following = following, []

    def make_free(self, cut: list[int]) -> None:
        """Let the rules of a cut cost nothing, and correct what costs less now."""
        task, of, hardest, cost = self._task, self.of, self.hardest, self.cost
        followers, adds, needs = self.followers, task.adds, task.needs
        fallen: list[list[int]] = [[] for _ in range(of[task.goal] + 1)]
        deepest = len(fallen) - 1
        for rule in cut:
            cost[rule] = 0
            now = of[hardest[rule]]
            for added in adds[rule]:
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
                for rule in followed:
                    if hardest[rule] != prop:
                        continue
                    dearest, now = prop, level
                    for need in needs[rule]:
                        if of[need] > now:
                            dearest, now = need, of[need]
                    hardest[rule] = dearest
                    followers[dearest].append(rule)
                    now += cost[rule]
                    for added in adds[rule]:
                        if now < of[added]:
                            of[added] = now
                            if now <= deepest:
                                fallen[now].append(added)


def _cut(task: RelaxedTask, props: list[int], distances: _Distances) -> list[int]:
    """The rules that lead into the region from which the goal costs nothing more."""
    adds, followers, hardest = task.adds, distances.followers, distances.hardest
    near = _free_of_charge(task, distances)
    seen = bytearray(task.size)
    for prop in props:
        seen[prop] = 1
    frontier = props.copy()
    cut = []
    while frontier:
        prop = frontier.pop()
        for rule in followers[prop]:
            if hardest[rule] != prop:
                continue
            new = []
            for added in adds[rule]:
                if near[added]:
                    cut.append(rule)
                    break
                if not seen[added]:
                    new.append(added)
            else:
                for added in new:
                    seen[added] = 1
                frontier += new
    return cut


def _free_of_charge(task: RelaxedTask, distances: _Distances) -> bytearray:
    """The propositions from which free rules lead to the goal."""
    makers, hardest, cost = task.makers, distances.hardest, distances.cost
    near = bytearray(task.size)
    near[task.goal] = 1
    frontier = [task.goal]
    while frontier:
        for rule in makers[frontier.pop()]:
            if not cost[rule]:
                need = hardest[rule]
                if need >= 0 and not near[need]:
                    near[need] = 1
                    frontier.append(need)
    return near
