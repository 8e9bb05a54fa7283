"""Plans for play: one at once by greedy best-first search, and better ones while there is time."""

from __future__ import annotations

from collections.abc import Iterator

from robotouille.planners.kitchen.compact_state import PLACE, PLAYERS, ROOT, ROWS, WAIT, WORDS
from robotouille.planners.kitchen.kernels import Ints, ints
from robotouille.planners.kitchen.kitchen_search import (
    COUNT,
    CUT,
    GOAL,
    PROMISE,
    PROMISES,
    Nodes,
    copy,
    margin,
    new_nodes,
    pop,
    push,
)
from robotouille.planners.kitchen.solver import PLANNER, KitchenSearch, SolverRun
from robotouille.planners.kitchen.transitions import act, options, running, spot, tick, unpack
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import Limits, Proof, SearchResult
from robotouille.planning.validation import replay

__all__ = ["KitchenAnytimeSearch"]

MAX_GREEDY_EXPANSIONS = 2_000
"""Expansions after which the greedy search is given up."""

NEAR = 1.05
"""By how much a plan may be longer than what is proven before another is sought for a team."""

EXACT, WEIGHT = 4, 6
"""Weights of the heuristic, in quarters: of plain A*, and of the search for a team."""


class KitchenAnytimeSearch:
    """A search from one state of a kitchen, by one player or two.

    One player has a plan at once, then the shortest. Two get another one, where theirs is not near
    to what is proven.
    """

    def __init__(self, search: KitchenSearch) -> None:
        self._search = search
        self._alone = search.model.kitchen[PLAYERS] == 1

    def greedy(self, limits: Limits) -> SearchResult | None:
        return _greedy_best_first(self._search, limits) if self._alone else None

    def improve(self, known: Plan | None, limits: Limits) -> SearchResult:
        if self._alone:
            return self._search.solve(limits)
        return _weighted(self._search, known, limits)


def _greedy_best_first(search: KitchenSearch, limits: Limits) -> SearchResult:
    """A plan for a player who is alone, by always going on from the best successor.

    The first successor of which f is no greater is good enough, so most are never looked at. Where
    there is none at all, it goes back to the best open state, if any. The bound is the heuristic at
    the start.
    """
    kitchen, nodes = search.model.kitchen, _start_nodes(search)
    if nodes.notes[PROMISE] == PROMISES and nodes.notes[GOAL] < 0:
        empty = nodes.notes[CUT] == PROMISES
        proof = Proof.EXHAUSTED if empty else Proof.NONE
        return SearchResult(None, 0, proof, PLANNER, 0, unsolvable=bool(empty))
    bound = 0 if nodes.notes[GOAL] >= 0 else int(nodes.notes[PROMISE])
    max_expansions = MAX_GREEDY_EXPANSIONS
    if limits.expansions is not None:
        max_expansions = min(limits.expansions, max_expansions)
    node, expansions = pop(nodes), 0
    while node >= 0 and nodes.notes[GOAL] < 0 and expansions < max_expansions:
        expansions += 1
        if nodes.notes[COUNT] + margin(1) > len(nodes.steps):
            nodes = new_nodes(kitchen, 2 * len(nodes.steps), nodes)
        node = _best_successor(kitchen, search.goals, nodes, node)
        if node < 0:
            node = pop(nodes)
    plan = _plan_to_goal(search, _path(nodes)) if nodes.notes[GOAL] >= 0 else None
    return SearchResult(plan, bound, Proof.HEURISTIC, PLANNER, expansions)


def _plan_to_goal(search: KitchenSearch, path: list[list[int]]) -> Plan:
    """The plan of a path, without what comes after the goal: time may bring it on a last walk."""
    plan = search.plan(path)
    return Plan(plan.steps[: replay(plan, search.model.world, search.start).reached_at])


def _start_nodes(search: KitchenSearch) -> Nodes:
    """The start, once for each goal assignment."""
    kitchen, goals = search.model.kitchen, search.goals
    nodes = new_nodes(kitchen, 1 << max(4 * margin(1), 2 * goals[ROWS]).bit_length())
    for row in range(goals[ROWS]):
        state = list(search.code)
        state[ROOT] = row
        push(kitchen, goals, nodes, ints(state), -1, 0, 0, EXACT)
    return nodes


def _best_successor(kitchen: Ints, goals: Ints, nodes: Nodes, node: int) -> int:
    """Of the new successors the one with the least f, then the least h; -1 if none is new.

    No others are made once there is one with the f of the state itself.
    """
    first, f = nodes.notes[COUNT], nodes.steps[node] + nodes.estimate[node]
    unpack(kitchen, nodes.key, node * kitchen[WORDS], nodes.s)
    for action, steps in _successors(kitchen, goals, nodes):
        before = nodes.notes[COUNT]
        push(kitchen, goals, nodes, nodes.t, node, action, nodes.steps[node] + steps, EXACT)
        if nodes.notes[GOAL] >= 0:
            break
        new = nodes.notes[COUNT] - 1
        if new >= before and nodes.steps[new] + nodes.estimate[new] <= f:
            break
    successors = range(first, nodes.notes[COUNT])
    return min(
        successors,
        key=lambda i: (nodes.steps[i] + nodes.estimate[i], nodes.estimate[i]),
        default=-1,
    )


def _successors(kitchen: Ints, goals: Ints, nodes: Nodes) -> Iterator[tuple[int, int]]:
    """What follows on the state in `nodes.s`, one after the other in `nodes.t`: the action and its
    steps.

    First what is done here, then what is done elsewhere, which takes a step to walk there; waiting
    comes last.
    """
    for action in list(nodes.acts[: options(kitchen, goals, nodes.s, 0, True, nodes.acts, 0)]):
        copy(kitchen, nodes.s, nodes.t)
        act(kitchen, nodes.t, 0, action)
        tick(kitchen, nodes.t)
        yield action, 1
    copy(kitchen, nodes.s, nodes.u)
    tick(kitchen, nodes.u)
    for action in list(nodes.acts[: options(kitchen, goals, nodes.u, 0, False, nodes.acts, 0)]):
        copy(kitchen, nodes.u, nodes.t)
        nodes.t[kitchen[PLACE]] = spot(kitchen, nodes.t, action)
        act(kitchen, nodes.t, 0, action)
        tick(kitchen, nodes.t)
        yield action, 2
    if running(kitchen, nodes.s):
        copy(kitchen, nodes.u, nodes.t)
        yield WAIT, 1


def _path(nodes: Nodes) -> list[list[int]]:
    """The actions that lead to the goal that was found."""
    node, actions = int(nodes.notes[GOAL]), []
    while nodes.parent[node] >= 0:
        actions.append([int(nodes.action[node])])
        node = int(nodes.parent[node])
    return actions[::-1]


def _weighted(search: KitchenSearch, known: Plan | None, limits: Limits) -> SearchResult:
    """Another plan for a team by weighted A*, unless a known one is near to what is proven.

    What does not promise to better that one is not left out: then the search would look in many
    more places, and find less.
    """
    run = SolverRun(search, WEIGHT, limits, None)
    bound = min(run.nodes.estimate[: run.nodes.notes[COUNT]], default=0)
    plan = None
    if known is None or len(known) > NEAR * bound:
        run.go(None)
        plan = search.plan(run.path()) if run.best is not None else None
    return SearchResult(plan, int(bound), Proof.HEURISTIC, PLANNER, run.expansions)
