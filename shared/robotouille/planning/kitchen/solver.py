"""The kitchen planner: shortest plans with proof, within limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from robotouille.planning.kitchen.compact_state import CompactState, GoalSpec
from robotouille.planning.kitchen.encoding import decode, encode
from robotouille.planning.kitchen.goal_assignments import goal_assignments
from robotouille.planning.kitchen.kernels import announce_compiling, record, records
from robotouille.planning.kitchen.model import KitchenModel, model_of
from robotouille.planning.kitchen.nodes import (
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
from robotouille.planning.kitchen.search import EMPTY, GROW, PAUSED, PROVEN, astar
from robotouille.planning.plan import UNLIMITED, Limits, Plan, Proof, SearchResult, Watch
from robotouille.world.world import State, World

PLANNER = "kitchen A* 3"

# The number of joint actions grows exponentially with the players, and so does the time for one
# expansion. All these numbers therefore depend on the number of players.
SLICE = (1_024, 256, 32, 4)
"""Expansions between two checks of the limits, by number of players."""

# Most short plans are found within these expansions. For longer ones a known plan helps: it prunes
# every state that cannot lead to a shorter one.
EXACT_FIRST = (2_000, 5_000, 3_000, 500)
"""Expansions before a quick plan is sought, by number of players."""

HASTY_EXPANSIONS = (3_000, 3_000, 1_500, 300)
"""Expansions of each quick search, by number of players."""

# A greater weight finds longer plans sooner. So the weights increase until some plan is found.
HASTY_WEIGHTS = (5, 6, 8, 12)
"""Weights of the heuristic in the quick searches, in quarters."""

UNDECIDED = (PAUSED, GROW)


def kitchen_search(world: World, start: State) -> KitchenSearch | None:
    """Return a search from a state, or None if the world or its goal is not supported.

    Raises:
        TooManyChoicesError: The goal can mean too many choices of objects.
    """
    model = model_of(world, start)
    if model is None:
        return None
    announce_compiling()
    compact = encode(model, start)
    goals = goal_assignments(model, compact)
    return None if goals is None else KitchenSearch(model, goals, start, compact)


class KitchenSearch:
    """A search from one state of a kitchen.

    `compact` is the start as a record. `goals` has one record for each goal assignment.
    """

    def __init__(
        self, model: KitchenModel, goals: Sequence[GoalSpec], start: State, compact: CompactState
    ) -> None:
        self.model = model
        self.start = start
        self.goals = records(GoalSpec, goals)
        self.compact = record(compact)

    def solve(
        self,
        limits: Limits = UNLIMITED,
        watch: Watch | None = None,
        other: Callable[[], Plan | None] | None = None,
    ) -> SearchResult:
        """Return the shortest plan, or the best plan and bound within the limits.

        Args:
            other: Another source of a plan, called if the shortest plan is not found at once.
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
        """Return the better one of a plan and a quick one, and the expansions spent."""
        spent = 0
        for weight in HASTY_WEIGHTS:
            run = SolverRun(self, weight, limits, watch)
            run.spent = exact.expansions + spent
            if best is not None:
                run.improve_on(len(best))
            # Without any plan the exact search prunes nothing, so the last pass runs to its end.
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
        # A lower plan may lead through an open state or through one that had no room.
        bound = min(run.lowest_f, run.cut, MAX_F if best is None else len(best))
        return SearchResult(best, bound, Proof.HEURISTIC, PLANNER, spent)

    def plan(self, path: Sequence[Sequence[tuple[int, int]]]) -> Plan:
        """Return a path of joint actions as a plan of the world."""
        return decode(self.model, self.start, self.compact, path)


class SolverRun:
    """One pass of weighted A* within limits, in slices.

    `spent` counts the expansions of earlier passes, which the limits include.
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
        self.nodes: Nodes = new_nodes(kitchen, self.room, weight)
        insert_starts(search.model.record, search.goals, self.nodes, search.compact)

    @property
    def over(self) -> bool:
        """True if the limits forbid any expansion."""
        if self.limits.stop is not None and self.limits.stop():
            return True
        return self.limits.expansions == 0

    @property
    def expansions(self) -> int:
        return int(self.nodes.status[EXPANDED])

    @property
    def lowest_f(self) -> int:
        """Lowest f of an open node."""
        return int(self.nodes.status[LOWEST_F])

    @property
    def cut(self) -> int:
        """Lowest f of the states that had no room."""
        return int(self.nodes.status[CUT])

    @property
    def is_exhausted(self) -> bool:
        """True if no state is left that can begin a better plan."""
        return self.goal_node is None and self.lowest_f == self.cut == MAX_F

    @property
    def goal_node(self) -> int | None:
        """Last node of the best plan found."""
        node = int(self.nodes.status[GOAL])
        return node if node >= 0 else None

    @property
    def best(self) -> int | None:
        """Length of the best plan found."""
        return None if self.goal_node is None else int(self.nodes.status[BEST])

    def improve_on(self, length: int) -> None:
        """Search only for plans shorter than `length`."""
        self.nodes.status[BEST] = length

    def go(self, expansions: int | None) -> None:
        """Continue for `expansions`, to the end if None, or to the limits."""
        model, goals = self.search.model, self.search.goals
        until = None if expansions is None else self.expansions + expansions
        while self.outcome in UNDECIDED:
            allowed = self._allowed(until)
            if allowed <= 0 or (self.limits.stop is not None and self.limits.stop()):
                self.outcome = PAUSED
                return
            self.outcome = astar(model.record, goals, self.nodes, allowed)
            if self.watch is not None:
                self.watch(self.spent + self.expansions, self.lowest_f, self.best)
            if self.outcome == GROW and not self._grow():
                return
            # Weighted passes only provide an upper bound; improving it is left to the exact pass.
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
        """Double the room for nodes if the limits allow it."""
        most = self.limits.states
        if most is not None and self.nodes.status[COUNT] >= most:
            return False
        self.room *= 2
        self.nodes = grown_nodes(self.search.model.kitchen, self.room, self.nodes)
        return True

    def path(self) -> list[list[tuple[int, int]]]:
        """Return the joint actions to the best goal found."""
        return path_to_goal(self.nodes, self.players)
