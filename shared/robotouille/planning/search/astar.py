"""Best-first search (A*) on the world's own steps: shortest plans in any domain, with proof.

P. E. Hart, N. J. Nilsson, B. Raphael: A formal basis for the heuristic determination of minimum
cost paths, 1968. A state is expanded in order of f = g + h: the steps taken so far, and a lower
bound on those missing. The heuristic is asked only when a state's turn comes: until then, h is one
less than the predecessor's (no step can bring the goal nearer by more than one). So f never falls
on the way, and the smallest one that is open is a proven bound at any time.
"""

from __future__ import annotations

import math
from collections import defaultdict
from typing import NamedTuple

from robotouille.planning.plan import Joint, Plan
from robotouille.planning.search.heuristics import Blind, Heuristic, default_heuristic
from robotouille.planning.search.joint_actions import Transitions
from robotouille.planning.search.symmetry import StateKey, state_keys
from robotouille.planning.search_result import UNLIMITED, Limits, Proof, SearchResult, Watch
from robotouille.world.timers import Timers
from robotouille.world.world import State, World

__all__ = ["PLANNER", "astar_search"]

PLANNER = "general 1"

PAUSE = 64
"""How many states are looked at between two questions whether to stop."""

BATCH = 64
"""How many successors of one state are made before it is looked at whether to stop."""


def astar_search(
    world: World,
    start: State | None = None,
    *,
    heuristic: Heuristic | None = None,
    limits: Limits = UNLIMITED,
    watch: Watch | None = None,
    symmetry: bool = True,
) -> SearchResult:
    """The shortest plan of all players of a world together, from `start` or from the beginning.

    By default LM-cut guides the search, or nothing where a relaxation would be too large. With
    `symmetry`, states that differ only in which of several like objects is which count as one.
    """
    state = world.initial if start is None else start
    if state.goal_reached:
        return SearchResult(Plan(()), 0, Proof.EXHAUSTED, PLANNER, 0)
    guide = default_heuristic(world, state) if heuristic is None else heuristic
    return _Search(world, guide, limits, watch, symmetry).run(state)


class SearchNode(NamedTuple):
    """A state on the way, and how it was reached; no plan from it has fewer steps than `h`."""

    facts: int
    timers: Timers
    key: StateKey
    g: int
    h: int
    evaluated: bool
    parent: SearchNode | None
    joint: Joint


class _Search:
    """One search: the g of the states known, and the open states by their f."""

    def __init__(
        self,
        world: World,
        heuristic: Heuristic,
        limits: Limits,
        watch: Watch | None,
        symmetry: bool,
    ) -> None:
        self._reached = world.goal.reached
        self._moves = Transitions(world).moves
        self._heuristic = heuristic
        self._limits = limits
        self._watch = watch
        self._key = state_keys(world, symmetry)
        self._proof = Proof.EXHAUSTED if isinstance(heuristic, Blind) else Proof.HEURISTIC
        self._known: dict[StateKey, int] = {}
        self._open: defaultdict[int, list[SearchNode]] = defaultdict(list)
        self._bound = 0
        self._expansions = 0
        self._looks = 0
        self._stopped = False

    def run(self, start: State) -> SearchResult:
        key = self._key(start.facts, start.timers)
        self._known[key] = 0
        self._open[1].append(SearchNode(start.facts, start.timers, key, 0, 1, False, None, ()))
        while self._open:
            self._bound = min(self._open)
            goal = self._expand_bucket(self._open[self._bound])
            if goal is not None:
                return self._result(_plan(goal))
            if self._stopped:
                return self._result(None)
            del self._open[self._bound]
        return self._result(None, unsolvable=True)

    def _expand_bucket(self, nodes: list[SearchNode]) -> SearchNode | None:
        """Look at every open state of the least f, until the goal is reached or it is stopped."""
        while nodes and not self._limit_reached():
            node = nodes.pop()
            if self._known[node.key] < node.g:
                continue
            if not node.evaluated:
                h = self._heuristic(node.facts, node.timers)
                if h == math.inf:
                    continue
                node = node._replace(h=max(node.h, int(h)), evaluated=True)
                if node.g + node.h > self._bound:
                    self._open[node.g + node.h].append(node)
                    continue
            goal = self._expand(node)
            if goal is not None or self._stopped:
                return goal
        return None

    def _expand(self, node: SearchNode) -> SearchNode | None:
        """Add a state's successors; the goal, if it is among them.

        That is then as near as any: the state had at least one step to go, and its f is the bound.
        """
        self._expansions += 1
        known, g = self._known, node.g + 1
        h = max(node.h - 1, 1)
        bucket = self._open[g + h]
        for number, (facts, timers, joint) in enumerate(self._moves(node.facts, node.timers), 1):
            if not number % BATCH and self._limit_reached():
                return None
            key = self._key(facts, timers)
            before = known.get(key)
            if before is not None and before <= g:
                continue
            known[key] = g
            after = SearchNode(facts, timers, key, g, h, False, node, joint)
            if self._reached(facts):
                return after
            bucket.append(after)
        return None

    def _limit_reached(self) -> bool:
        """Whether a limit has been reached, which ends the search."""
        limits = self._limits
        most_expansions = math.inf if limits.expansions is None else limits.expansions
        most_states = math.inf if limits.states is None else limits.states
        self._looks += 1
        if self._expansions >= most_expansions or len(self._known) >= most_states:
            self._stopped = True
        elif not self._looks % PAUSE:
            if self._watch is not None:
                self._watch(self._expansions, self._bound, None)
            self._stopped = limits.stop is not None and limits.stop()
        return self._stopped

    def _result(self, plan: Plan | None, unsolvable: bool = False) -> SearchResult:
        return SearchResult(plan, self._bound, self._proof, PLANNER, self._expansions, unsolvable)


def _plan(goal: SearchNode) -> Plan:
    steps: list[Joint] = []
    node = goal
    while node.parent is not None:
        steps.append(node.joint)
        node = node.parent
    return Plan(tuple(reversed(steps)))
