"""The kitchen planner's plug-in for `robotouille.planning.solvers`, and its anytime search."""

from __future__ import annotations

from dataclasses import replace

from robotouille.planning.beam.planner import BeamPlanner
from robotouille.planning.kitchen.goal_assignments import TooManyChoicesError
from robotouille.planning.kitchen.model import rules_of
from robotouille.planning.kitchen.nodes import (
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
from robotouille.planning.kitchen.search import best_successor
from robotouille.planning.kitchen.solver import PLANNER, KitchenSearch, SolverRun, kitchen_search
from robotouille.planning.plan import Joint, Limits, Plan, Proof, SearchResult, Watch, replay
from robotouille.world.world import State, World

MAX_GREEDY_EXPANSIONS = 2_000
"""Expansions after which the greedy search gives up."""

NEAR = 1.05
"""Ratio of a plan's length to the proven bound up to which no other plan is sought for a team."""

HOPEFUL = 1.25
"""Ratio of a plan's length to the best one up to which its end is shortened."""

TEAM_WEIGHT = 6
"""Weight of the heuristic in the search for a team, in quarters."""

LAST_STEPS = 6
"""Shortest end that is searched: shorter ones are almost always optimal."""

STRIDE = 2
"""Steps between two states from which an end is sought."""

SHARE = 8
"""Divisor of the expansion limit for the search of one end."""

END_EXPANSIONS = 64
"""Expansions for one end without a limit."""


class KitchenAnytimeSearch:
    """A search for play from one state of a kitchen, by one player or two.

    For one player it returns a plan at once, then the shortest. For two players it seeks a second
    plan if theirs is not near the bound, and shortens the ends of both.
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
    """Return a plan for a single player by always expanding the best successor.

    The bound is the heuristic at the start.
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
    # A successor with its parent's f is good enough, so most successors are never evaluated.
    # Without new successors the search continues from the best open state.
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
    """Return the plan up to the goal."""
    # The last action includes a walk, during which a delay may already meet the goal.
    plan = search.plan(path_to_goal(nodes, 1))
    return Plan(plan.steps[: replay(plan, search.model.world, search.start).reached_at])


def _start_nodes(search: KitchenSearch) -> Nodes:
    """Return nodes with the start once for each goal assignment."""
    room = 1 << max(4 * max_successors(1), 2 * len(search.goals)).bit_length()
    nodes = new_nodes(search.model.kitchen, room)
    insert_starts(search.model.record, search.goals, nodes, search.compact)
    return nodes


def _weighted(search: KitchenSearch, known: Plan | None, limits: Limits) -> SearchResult:
    """Return another plan for a team by weighted A*, unless the known plan is near the bound."""
    run = SolverRun(search, TEAM_WEIGHT, limits, None)
    bound = min(run.nodes.h[: run.nodes.status[COUNT]], default=0)
    plan = None
    # The known plan does not prune this search: with pruning it spreads over more states and finds
    # less within its limit.
    if known is None or len(known) > NEAR * bound:
        run.go(None)
        plan = search.plan(run.path()) if run.best is not None else None
    return SearchResult(plan, int(bound), Proof.HEURISTIC, PLANNER, run.expansions)


def _shorten_ends(plan: Plan, start: State, limits: Limits) -> tuple[Plan, int]:
    """Return the plan, perhaps with a shorter end, and the expansions spent."""
    steps, spent = list(plan), 0
    states = _states(steps, start)
    # From late states the shortest way to the goal is found quickly, so the ends are searched from
    # the last steps backwards. After a success the search returns a few steps, because the states
    # behind have changed.
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
    """Return the steps from a state to the goal if there are fewer than `length`."""
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


# Larger teams have too many joint actions for a search of all of them during play.
MAX_ANYTIME_PLAYERS = 2

BEAM = 4_000
"""Expansions of the beam search for a team."""


class KitchenPlanner:
    """Planner for worlds that are kitchens."""

    def recognises(self, world: World) -> bool:
        return rules_of(world) is not None

    def solve(
        self, world: World, start: State, limits: Limits, watch: Watch | None
    ) -> SearchResult | None:
        search = _search(world, start)
        if search is None:
            return None
        if len(world.players) == 1:
            return search.solve(limits, watch)
        return search.solve(limits, watch, lambda: _team_plan(world, start, limits))

    def anytime(self, world: World, start: State) -> KitchenAnytimeSearch | None:
        search = _search(world, start) if len(world.players) <= MAX_ANYTIME_PLAYERS else None
        return None if search is None else KitchenAnytimeSearch(search)


KITCHEN = KitchenPlanner()


def _search(world: World, start: State) -> KitchenSearch | None:
    try:
        return kitchen_search(world, start)
    except TooManyChoicesError:
        return None


def _team_plan(world: World, start: State, limits: Limits) -> Plan | None:
    """Return a beam search's plan for several players, whose shortest plans are hard to find."""
    planner, players = BeamPlanner(world), tuple(world.players)
    # More than two players get in each other's way, so pairs are tried too, while the others stand
    # still.
    pairs = [players[:2], players[1:3]] if len(players) > 2 else []
    plans = []
    for team in (players, *pairs):
        if limits.stop is not None and limits.stop():
            break
        solution = planner.solve(start, team, expansions=BEAM, stop=limits.stop)
        if solution.reached:
            plans.append(solution.plan)
    return min(plans, key=len, default=None)
