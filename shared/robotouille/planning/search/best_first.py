"""A* and greedy best-first search on the world's own steps, in any domain.

A* (P. E. Hart, N. J. Nilsson, B. Raphael: A formal basis for the heuristic determination of minimum
cost paths, 1968) finds shortest plans with proof. Greedy search (J. E. Doran, D. Michie:
Experiments with the graph traverser program, 1966) finds some plan if nothing else does. See
docs/decisions/0011-general-planner.md.
"""

from __future__ import annotations

import heapq
import math
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from robotouille.planning.plan import UNLIMITED, Joint, Limits, Plan, Proof, SearchResult, Watch
from robotouille.planning.search.heuristics import Blind, Heuristic, default_heuristic
from robotouille.planning.search.symmetry import StateKey, state_keys
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.timers import Timers
from robotouille.world.world import State, World


class JointMove(NamedTuple):
    """The facts and timers after a step, and its joint action."""

    facts: int
    timers: Timers
    joint: Joint


class Transitions:
    """Steps of the players of `team` (by default all) together (docs/episodes.md, "A step")."""

    def __init__(self, world: World, team: Sequence[str] = ()) -> None:
        self._world = world
        # Each player takes one action or none, one after another. A player may use what an earlier
        # one has done in the same step, so all orders are tried. Partial steps with equal facts,
        # timers and acted players are continued once.
        self._players = tuple(p for p in world.players if p in team or not team)

    def moves(self, facts: int, timers: Timers) -> Iterable[JointMove]:
        """Return all steps that change anything or let time pass."""
        if len(self._players) == 1:
            return self._alone(facts, timers)
        return self._together(facts, timers)

    def _alone(self, facts: int, timers: Timers) -> list[JointMove]:
        found = []
        if timers.pending:
            found.append(JointMove(*_let_time_pass(facts, timers), ()))
        for action in self._world.actions(State(self._world, facts, timers), self._players[0]):
            after, running = _act(facts, timers, action)
            if running.pending:
                after, running = _let_time_pass(after, running)
            found.append(JointMove(after, running, (action,)))
        return found

    def _together(self, facts: int, timers: Timers) -> Iterator[JointMove]:
        """Yield the joint actions of several players, each with the time that passes after it."""
        if timers.pending:
            yield JointMove(*_let_time_pass(facts, timers), ())
        start = (facts, timers, frozenset[str]())
        found: dict[tuple[int, Timers, frozenset[str]], Joint] = {start: ()}
        frontier = deque([start])
        while frontier:
            key = frontier.popleft()
            now, running, acted = key
            state = State(self._world, now, running)
            for player in self._players:
                if player in acted:
                    continue
                for action in self._world.actions(state, player):
                    after, started = _act(now, running, action)
                    reached = (after, started, acted | {player})
                    if reached in found or (after == now and started is running):
                        continue
                    joint = found[reached] = (*found[key], action)
                    frontier.append(reached)
                    yield JointMove(*_let_time_pass(after, started), joint)


def _act(facts: int, timers: Timers, action: GroundAction) -> tuple[int, Timers]:
    """Apply an action before time passes."""
    facts = (facts | action.touched) ^ action.removed
    if action.effects or action.duration > 1:
        touched, removed, timers = timers.begin(action, facts)
        facts = (facts | touched) ^ removed
    return facts, timers


def _let_time_pass(facts: int, timers: Timers) -> tuple[int, Timers]:
    touched, removed, timers = timers.tick(facts)
    return (facts | touched) ^ removed, timers


PLANNER = "general 1"

PAUSE = 64
"""Number of states between two checks of `stop`."""

BATCH = 64
"""Number of successors of one state between two checks of the limits."""


def astar_search(
    world: World,
    start: State | None = None,
    *,
    heuristic: Heuristic | None = None,
    limits: Limits = UNLIMITED,
    watch: Watch | None = None,
    symmetry: bool = True,
) -> SearchResult:
    """Return a shortest plan of all players from `start`, by default the initial state.

    The default heuristic is LM-cut, or none if a relaxation would be too large. With `symmetry`,
    states that differ only in the names of interchangeable objects count as one.
    """
    state = world.initial if start is None else start
    if state.goal_reached:
        return SearchResult(Plan(()), 0, Proof.EXHAUSTED, PLANNER, 0)
    guide = default_heuristic(world, state) if heuristic is None else heuristic
    return _Search(world, guide, limits, watch, symmetry).run(state)


class SearchNode(NamedTuple):
    """A state, and how it was reached. No plan from it has fewer than `h` steps."""

    facts: int
    timers: Timers
    key: StateKey
    g: int
    h: int
    evaluated: bool
    parent: SearchNode | None
    joint: Joint


class _Search:
    """One search: the `g` of the known states, and the open states by their f."""

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
        """Expand open states of the lowest f until the goal or a limit is reached."""
        while nodes and not self._limit_reached():
            node = nodes.pop()
            if self._known[node.key] < node.g:
                continue
            if not node.evaluated:
                # The heuristic is slow, so it is computed only when a state's turn comes. Until
                # then h is one less than the parent's, since a step brings the goal at most one
                # step nearer.
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
        """Add a state's successors. Return a goal state if there is one among them."""
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
            # No goal state is nearer: its parent had at least one step to go, and its f is the
            # bound.
            if self._reached(facts):
                return after
            bucket.append(after)
        return None

    def _limit_reached(self) -> bool:
        """Return whether a limit ends the search."""
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


GREEDY = "greedy 1"

Path = tuple["Path", Joint] | None
"""The joint actions that lead to a state, in reverse order."""

# The negative number makes the heap return the newest of equally promising states.
OpenState = tuple[float, int, int, Timers, Path]
"""The estimated distance, the negative number of the state, its facts, timers and path."""


def greedy_search(
    world: World,
    start: State,
    *,
    team: Sequence[str] = (),
    heuristic: Heuristic | None = None,
    limits: Limits = UNLIMITED,
) -> SearchResult:
    """Return a plan for the players of `team` (by default all), while the others do nothing.

    The result is `unsolvable` only if the search visited every state that all players can reach.
    """
    if start.goal_reached:
        return SearchResult(Plan(()), 0, Proof.EXHAUSTED, GREEDY, 0)
    moves = Transitions(world, team).moves
    distance = heuristic or default_heuristic(world, start)
    everybody = not team or set(team).issuperset(world.players)
    key = state_keys(world, symmetry=everybody)
    known = {key(start.facts, start.timers)}
    frontier: list[OpenState] = [(0.0, 0, start.facts, start.timers, None)]
    expansions = 0
    while frontier and not limits.reached(expansions, len(known)):
        _, _, facts, timers, path = heapq.heappop(frontier)
        expansions += 1
        for after, running, joint in moves(facts, timers):
            state_key = key(after, running)
            if state_key in known:
                continue
            known.add(state_key)
            if world.goal.reached(after):
                return SearchResult(_path_plan((path, joint)), 0, Proof.NONE, GREEDY, expansions)
            left = distance(after, running)
            if left < math.inf:
                heapq.heappush(frontier, (left, -len(known), after, running, (path, joint)))
    unsolvable = everybody and not frontier
    proof = Proof.EXHAUSTED if unsolvable else Proof.NONE
    return SearchResult(None, 0, proof, GREEDY, expansions, unsolvable)


def _path_plan(path: Path) -> Plan:
    steps: list[Joint] = []
    while path is not None:
        path, joint = path
        steps.append(joint)
    return Plan(tuple(reversed(steps)))
