"""Plans for play: one at once by greedy best-first search, and better ones while there is time."""

from __future__ import annotations

from dataclasses import replace

from robotouille.planners.kitchen.goal_assignments import TooManyChoicesError
from robotouille.planners.kitchen.search.nodes import (
    COUNT,
    CUT,
    GOAL,
    LOWEST_F,
    MAX_F,
    UNIT,
    Nodes,
    grown_nodes,
    insert_starts,
    max_successors,
    new_nodes,
    path_to_goal,
    pop,
)
from robotouille.planners.kitchen.search.one_player import best_successor
from robotouille.planners.kitchen.solver import (
    PLANNER,
    KitchenSearch,
    SolverRun,
    kitchen_search,
)
from robotouille.planning.plan import Joint, Plan
from robotouille.planning.search_result import Limits, Proof, SearchResult
from robotouille.planning.validation import replay
from robotouille.world.world import State

__all__ = ["KitchenAnytimeSearch"]

MAX_GREEDY_EXPANSIONS = 2_000
"""Expansions after which the greedy search is given up."""

NEAR = 1.05
"""By how much a plan may be longer than what is proven before another is sought for a team."""

HOPEFUL = 1.25
"""By how much a plan may be longer than another for its end to be looked at."""

TEAM_WEIGHT = 6
"""The weight of the heuristic in the search for a team, in quarters."""

LAST_STEPS = 6
"""An end of fewer steps is not looked at: it is hardly ever too long."""

STRIDE = 2
"""Steps between two states from which an end is sought."""

SHARE = 8
"""The part of all expansions that may be spent on one end."""

END_EXPANSIONS = 64
"""For one end, where there is no limit."""


class KitchenAnytimeSearch:
    """A search from one state of a kitchen, by one player or two.

    One player has a plan at once, then the shortest. Two get another one, where theirs is not near
    to what is proven, and shorter ends for both.
    """

    def __init__(self, search: KitchenSearch) -> None:
        self._search = search
        self._alone = search.model.kitchen.players == 1

    def greedy(self, limits: Limits) -> SearchResult | None:
        return _greedy_best_first(self._search, limits) if self._alone else None

    def improve(self, known: Plan | None, limits: Limits) -> SearchResult:
        if self._alone:
            return self._search.solve(limits)
        found = _weighted(self._search, known, limits)
        plans = [plan for plan in (found.plan, known) if plan is not None]
        if not plans or len(known or ()) == found.bound:
            return found
        near = HOPEFUL * min(map(len, plans))
        ends = [_shorten_ends(p, self._search.start, limits) for p in plans if len(p) <= near]
        spent = found.expansions + sum(expansions for _, expansions in ends)
        best = min((plan for plan, _ in ends), key=len)
        return replace(found, plan=best, expansions=spent)


def _greedy_best_first(search: KitchenSearch, limits: Limits) -> SearchResult:
    """A plan for a player who is alone, by always going on from the best successor.

    The first successor of which f is no greater is good enough, so most are never looked at. Where
    there is none at all, it goes back to the best open state, if any. The bound is the heuristic at
    the start.
    """
    kitchen, nodes = search.model.record, _start_nodes(search)
    if nodes.status[LOWEST_F] == MAX_F and nodes.status[GOAL] < 0:
        empty = nodes.status[CUT] == MAX_F
        proof = Proof.EXHAUSTED if empty else Proof.NONE
        return SearchResult(None, 0, proof, PLANNER, 0, unsolvable=bool(empty))
    bound = 0 if nodes.status[GOAL] >= 0 else int(nodes.status[LOWEST_F])
    max_expansions = MAX_GREEDY_EXPANSIONS
    if limits.expansions is not None:
        max_expansions = min(limits.expansions, max_expansions)
    node, expansions = pop(nodes), 0
    while node >= 0 and nodes.status[GOAL] < 0 and expansions < max_expansions:
        expansions += 1
        room = len(nodes.g)
        if nodes.status[COUNT] + max_successors(1) > room:
            nodes = grown_nodes(search.model.kitchen, 2 * room, nodes)
        node = best_successor(kitchen, search.goals, nodes, node)
        if node < 0:
            node = pop(nodes)
    plan = _plan_to_goal(search, nodes) if nodes.status[GOAL] >= 0 else None
    return SearchResult(plan, bound, Proof.HEURISTIC, PLANNER, expansions)


def _plan_to_goal(search: KitchenSearch, nodes: Nodes) -> Plan:
    """The plan that was found, without what comes after the goal: time may bring it on a last
    walk."""
    plan = search.plan(path_to_goal(nodes, 1))
    return Plan(plan.steps[: replay(plan, search.model.world, search.start).reached_at])


def _start_nodes(search: KitchenSearch) -> Nodes:
    """The start, once for each goal assignment."""
    room = 1 << max(4 * max_successors(1), 2 * len(search.goals)).bit_length()
    nodes = new_nodes(search.model.kitchen, room)
    insert_starts(search.model.record, search.goals, nodes, search.compact, UNIT)
    return nodes


def _weighted(search: KitchenSearch, known: Plan | None, limits: Limits) -> SearchResult:
    """Another plan for a team by weighted A*, unless a known one is near to what is proven.

    What does not promise to better that one is not left out: then the search would look in many
    more places, and find less.
    """
    run = SolverRun(search, TEAM_WEIGHT, limits, None)
    bound = min(run.nodes.h[: run.nodes.status[COUNT]], default=0)
    plan = None
    if known is None or len(known) > NEAR * bound:
        run.go(None)
        plan = search.plan(run.path()) if run.best is not None else None
    return SearchResult(plan, int(bound), Proof.HEURISTIC, PLANNER, run.expansions)


def _shorten_ends(plan: Plan, start: State, limits: Limits) -> tuple[Plan, int]:
    """The plan or one with a shorter end, and the expansions it took.

    From late states on the shortest way to the goal is soon found. So ends are looked at from the
    last steps forward. Where one gets shorter, the search goes back a few steps: what is behind has
    changed.
    """
    steps, spent = list(plan), 0
    states = _states(steps, start)
    at = len(steps) - LAST_STEPS
    while at >= 0 and not (limits.stop is not None and limits.stop()):
        found, expansions = _end(states[at], len(steps) - at, limits)
        spent += expansions
        if found is not None:
            steps[at:] = found
            states[at:] = _states(found, states[at])
            at = min(len(steps) - LAST_STEPS, at + 2 * STRIDE)
        at -= STRIDE
    return Plan(tuple(steps)), spent


def _states(steps: list[Joint], start: State) -> list[State]:
    states = [start]
    for joint in steps:
        states.append(states[-1].step(joint).state)
    return states


def _end(start: State, length: int, limits: Limits) -> tuple[list[Joint] | None, int]:
    """The steps from a state to the goal, if fewer than some length are found."""
    try:
        search = kitchen_search(start.world, start)
    except TooManyChoicesError:
        return None, 0
    if search is None:
        return None, 0
    most = END_EXPANSIONS if limits.expansions is None else limits.expansions // SHARE
    run = SolverRun(search, UNIT, Limits(most, limits.states, limits.stop), None)
    run.improve_on(length)
    run.go(None)
    found = None if run.goal_node is None else list(search.plan(run.path()))
    return found, run.expansions
