"""The kitchen planner: shortest plans with proof, and good ones at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from robotouille.planners.kitchen.compact_state import CompactState, Goal
from robotouille.planners.kitchen.decode import decode
from robotouille.planners.kitchen.encode import encode
from robotouille.planners.kitchen.goal_assignments import goal_assignments
from robotouille.planners.kitchen.kernels import record, records
from robotouille.planners.kitchen.model import KitchenModel, model_of
from robotouille.planners.kitchen.search.astar import EMPTY, GROW, PAUSED, PROVEN, astar
from robotouille.planners.kitchen.search.nodes import (
    BEST,
    COUNT,
    CUT,
    EXPANDED,
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
)
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import UNLIMITED, Limits, Proof, SearchResult, Watch
from robotouille.world.world import State, World

__all__ = ["PLANNER", "KitchenSearch", "SolverRun", "kitchen_search"]

PLANNER = "kitchen A* 1"

SLICE = (1_024, 256, 16, 1)
"""Expansions between two questions whether to stop, by the number of players."""

EXACT_FIRST = (2_000, 1_000, 100, 20)
"""Expansions after which a plan is sought in haste, so that what cannot better it is left out; by
the number of players, since each has its choices in every step."""

HASTY_EXPANSIONS = (3_000, 1_500, 150, 30)
"""Expansions for each attempt at that, by the number of players."""

HASTY_WEIGHTS = (5, 6, 8, 12)
"""Weights of the heuristic of these attempts, in quarters."""

UNDECIDED = (PAUSED, GROW)


def kitchen_search(world: World, start: State) -> KitchenSearch | None:
    """A search from a state, if the world is a kitchen and its goal is one of a kitchen's.

    Raises TooManyChoicesError.
    """
    model = model_of(world, start)
    if model is None:
        return None
    compact = encode(model, start)
    goals = goal_assignments(model, compact)
    return None if goals is None else KitchenSearch(model, goals, start, compact)


class KitchenSearch:
    """A search from one state of a kitchen.

    `compact` is the start, and there is one of `goals` for each goal assignment; both are for
    kernels.
    """

    def __init__(
        self, model: KitchenModel, goals: Sequence[Goal], start: State, compact: CompactState
    ) -> None:
        self.model = model
        self.start = start
        self.goals = records(Goal, goals)
        self.compact = record(compact)

    def solve(
        self,
        limits: Limits = UNLIMITED,
        watch: Watch | None = None,
        other: Callable[[], Plan | None] | None = None,
    ) -> SearchResult:
        """The shortest plan, or the best one and the best bound within the limits.

        `other` is another source of a plan, asked where the shortest is not found at once.
        """
        players = self.model.kitchen.players
        exact = SolverRun(self, UNIT, limits, watch)
        exact.go(EXACT_FIRST[players - 1])
        best: Plan | None = None
        if exact.outcome in UNDECIDED and exact.best is None and limits.expansions != 0:
            best = None if other is None or exact.over else other()
            best, exact.spent = self._hasty(exact, limits, watch, best)
            if best is not None:
                exact.improve_on(len(best))
        exact.go(None)
        if exact.goal_node is not None:
            best = self.plan(exact.path())
        return self._answer(best, exact)

    def _hasty(
        self, exact: SolverRun, limits: Limits, watch: Watch | None, best: Plan | None
    ) -> tuple[Plan | None, int]:
        """A plan found in haste, if it is better, and the expansions it took."""
        spent = 0
        for weight in HASTY_WEIGHTS:
            run = SolverRun(self, weight, limits, watch)
            run.spent = exact.expansions + spent
            if best is not None:
                run.improve_on(len(best))
            last = weight == HASTY_WEIGHTS[-1] and best is None
            run.go(None if last else HASTY_EXPANSIONS[run.players - 1])
            spent += run.expansions
            if run.best is not None:
                best = self.plan(run.path())
        return best, spent

    def _answer(self, best: Plan | None, run: SolverRun) -> SearchResult:
        spent = run.spent + run.expansions
        if run.outcome in (PROVEN, EMPTY) or run.is_exhausted:
            if best is None:
                return SearchResult(None, 0, Proof.EXHAUSTED, PLANNER, spent, unsolvable=True)
            return SearchResult(best, len(best), Proof.HEURISTIC, PLANNER, spent)
        bound = min(run.lowest_f, run.cut, MAX_F if best is None else len(best))
        return SearchResult(best, bound, Proof.HEURISTIC, PLANNER, spent)

    def plan(self, path: Sequence[Sequence[tuple[int, int]]]) -> Plan:
        """A path of joint actions as a plan of the world."""
        return decode(self.model, self.start, self.compact, path)


class SolverRun:
    """One pass of A* with a weight (in quarters), in slices, within limits.

    `spent` are expansions of earlier passes, which count too.
    """

    def __init__(
        self, search: KitchenSearch, weight: int, limits: Limits, watch: Watch | None
    ) -> None:
        self.search, self.weight, self.limits, self.watch = search, weight, limits, watch
        self.spent = 0
        self.outcome = PAUSED
        kitchen = search.model.kitchen
        self.players = kitchen.players
        self.room = 2 * max_successors(self.players)
        while self.room < 4 * len(search.goals):
            self.room *= 2
        self.nodes: Nodes = new_nodes(kitchen, self.room)
        insert_starts(search.model.record, search.goals, self.nodes, search.compact, weight)

    @property
    def over(self) -> bool:
        """Whether the limits allow nothing at all."""
        if self.limits.stop is not None and self.limits.stop():
            return True
        return self.limits.expansions == 0

    @property
    def expansions(self) -> int:
        return int(self.nodes.status[EXPANDED])

    @property
    def lowest_f(self) -> int:
        """The lowest f of an open node."""
        return int(self.nodes.status[LOWEST_F])

    @property
    def cut(self) -> int:
        """The lowest f of the states that had no room."""
        return int(self.nodes.status[CUT])

    @property
    def is_exhausted(self) -> bool:
        """Whether no state is left from which a better plan could begin."""
        return self.goal_node is None and self.lowest_f == self.cut == MAX_F

    @property
    def goal_node(self) -> int | None:
        """The last node of the best plan that was found."""
        node = int(self.nodes.status[GOAL])
        return node if node >= 0 else None

    @property
    def best(self) -> int | None:
        """The length of the best plan that was found."""
        return None if self.goal_node is None else int(self.nodes.status[BEST])

    def improve_on(self, length: int) -> None:
        """Leave out what is not shorter than a known plan."""
        self.nodes.status[BEST] = length

    def go(self, expansions: int | None) -> None:
        """Go on for so many expansions, or to the end, or to the limits."""
        model, goals = self.search.model, self.search.goals
        until = None if expansions is None else self.expansions + expansions
        while self.outcome in UNDECIDED:
            allowed = self._allowed(until)
            if allowed <= 0 or (self.limits.stop is not None and self.limits.stop()):
                self.outcome = PAUSED
                return
            self.outcome = astar(model.record, goals, self.nodes, self.weight, allowed)
            if self.watch is not None:
                self.watch(self.spent + self.expansions, self.lowest_f, self.best)
            if self.outcome == GROW and not self._grow():
                return
            if self.weight > UNIT and self.best is not None:
                return

    def _allowed(self, until: int | None) -> int:
        allowed = SLICE[self.players - 1]
        if until is not None:
            allowed = min(allowed, until - self.expansions)
        if self.limits.expansions is not None:
            allowed = min(allowed, self.limits.expansions - self.spent - self.expansions)
        return allowed

    def _grow(self) -> bool:
        """Make room for twice as many nodes, if the limits allow it."""
        most = self.limits.states
        if most is not None and self.nodes.status[COUNT] >= most:
            return False
        self.room *= 2
        self.nodes = grown_nodes(self.search.model.kitchen, self.room, self.nodes)
        return True

    def path(self) -> list[list[tuple[int, int]]]:
        """The joint actions that lead to the best goal found."""
        return path_to_goal(self.nodes, self.players)
