"""Greedy best-first search: some plan, in any domain, where nothing else finds one.

What is expanded next is the state that seems nearest to the goal, however far from the start
(J. E. Doran, D. Michie: Experiments with the graph traverser program, 1966). Of equal ones it is
the newest.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

from robotouille.planning.plan import Joint, Plan
from robotouille.planning.search.heuristics import Heuristic, default_heuristic
from robotouille.planning.search.joint_actions import Transitions
from robotouille.planning.search.symmetry import state_keys
from robotouille.planning.search_result import UNLIMITED, Limits, Proof, SearchResult
from robotouille.world.timers import Timers
from robotouille.world.world import State, World

__all__ = ["PLANNER", "greedy_search"]

PLANNER = "greedy 1"

Path = tuple["Path", Joint] | None
"""The joint actions that lead to a state, the last one first."""

OpenState = tuple[float, int, int, Timers, Path]
"""The steps that seem to be missing; minus the state's number; its facts, timers and path."""


def greedy_search(
    world: World,
    start: State,
    *,
    team: Sequence[str] = (),
    heuristic: Heuristic | None = None,
    limits: Limits = UNLIMITED,
) -> SearchResult:
    """A plan for the players of `team` (all, if empty), the others doing nothing.

    It says that there is none only where it has seen every state that all players can bring about.
    """
    if start.goal_reached:
        return SearchResult(Plan(()), 0, Proof.EXHAUSTED, PLANNER, 0)
    moves = Transitions(world, team).moves
    distance = heuristic or default_heuristic(world, start)
    everybody = not team or set(team).issuperset(world.players)
    key = state_keys(world, symmetry=everybody)
    known = {key(start.facts, start.timers)}
    frontier: list[OpenState] = [(0.0, 0, start.facts, start.timers, None)]
    expansions = 0
    while frontier and not _exhausted(limits, expansions, len(known)):
        _, _, facts, timers, path = heapq.heappop(frontier)
        expansions += 1
        for after, running, joint in moves(facts, timers):
            state_key = key(after, running)
            if state_key in known:
                continue
            known.add(state_key)
            if world.goal.reached(after):
                return SearchResult(_plan((path, joint)), 0, Proof.NONE, PLANNER, expansions)
            left = distance(after, running)
            if left < math.inf:
                heapq.heappush(frontier, (left, -len(known), after, running, (path, joint)))
    unsolvable = everybody and not frontier
    proof = Proof.EXHAUSTED if unsolvable else Proof.NONE
    return SearchResult(None, 0, proof, PLANNER, expansions, unsolvable)


def _exhausted(limits: Limits, expansions: int, states: int) -> bool:
    if limits.expansions is not None and expansions >= limits.expansions:
        return True
    if limits.states is not None and states >= limits.states:
        return True
    return limits.stop is not None and limits.stop()


def _plan(path: Path) -> Plan:
    steps: list[Joint] = []
    while path is not None:
        path, joint = path
        steps.append(joint)
    return Plan(tuple(reversed(steps)))
