"""The kitchen planner: shortest plans with proof, and good ones at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from robotouille.planners.kitchen.compact_state import PLAYERS, ROOT, ROWS, WAIT
from robotouille.planners.kitchen.decode import decode
from robotouille.planners.kitchen.goal_assignments import goals_of
from robotouille.planners.kitchen.kernels import Ints, ints
from robotouille.planners.kitchen.kitchen_search import (
    BEST,
    BITS,
    COUNT,
    CUT,
    EMPTY,
    EXPANDED,
    GOAL,
    GROW,
    ORDER,
    PAUSED,
    PROMISE,
    PROMISES,
    PROVEN,
    Nodes,
    margin,
    new_nodes,
    push,
    run,
)
from robotouille.planners.kitchen.model import KitchenModel, model_of
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import UNLIMITED, Limits, Proof, SearchResult, Watch
from robotouille.world.state import State
from robotouille.world.world import World

__all__ = ["PLANNER", "KitchenSearch", "SolverRun", "kitchen_search"]

PLANNER = "kitchen A* 1"

SLICE = (1_024, 256, 16, 1)
"""Expansions between two questions whether to stop, by the number of players."""

HOPEFUL = (2_000, 1_000, 100, 20)
"""Expansions after which a plan is sought in haste, so that what cannot better it is left out; by
the number of players, since each has its choices in every step."""

HURRY = (3_000, 1_500, 150, 30)
"""Expansions for each attempt at that."""

UNDECIDED = (PAUSED, GROW)

EXACT, HASTY = 4, (5, 6, 8, 12)
"""Weights of the estimate, in quarters."""


def kitchen_search(world: World, start: State) -> KitchenSearch | None:
    """A search from a state, if the world is a kitchen and its goal is one of a kitchen's."""
    model = model_of(world, start)
    if model is None:
        return None
    code = model.encode(start)
    goals = goals_of(model, code)
    return None if goals is None else KitchenSearch(model, goals, start, code)


class KitchenSearch:
    """A search from one state of a kitchen."""

    def __init__(self, model: KitchenModel, goals: Ints, start: State, code: list[int]) -> None:
        self.model = model
        self.goals = goals
        self.start = start
        self.code = code

    def solve(
        self,
        limits: Limits = UNLIMITED,
        watch: Watch | None = None,
        other: Callable[[], Plan | None] | None = None,
    ) -> SearchResult:
        """The shortest plan, or the best one and the best bound within the limits.

        `other` is another source of a plan, asked where the shortest is not found at once.
        """
        players = int(self.model.kitchen[PLAYERS])
        exact = SolverRun(self, EXACT, limits, watch)
        exact.go(HOPEFUL[players - 1])
        best: Plan | None = None
        if exact.status in UNDECIDED and exact.best is None:
            best = None if other is None or exact.over else other()
            best, exact.spent = self._hasty(exact, limits, watch, best)
            if best is not None:
                exact.improve_on(len(best))
        exact.go(None)
        if exact.nodes.notes[GOAL] >= 0:
            best = self.plan(exact.path())
        return self._answer(best, exact)

    def _hasty(
        self, exact: SolverRun, limits: Limits, watch: Watch | None, best: Plan | None
    ) -> tuple[Plan | None, int]:
        """A plan found in haste, if it is better, and the expansions it took."""
        spent = 0
        for weight in HASTY:
            run = SolverRun(self, weight, limits, watch)
            run.spent = exact.expansions + spent
            if best is not None:
                run.improve_on(len(best))
            run.go(None if weight == HASTY[-1] and best is None else HURRY[run.players - 1])
            spent += run.expansions
            if run.best is not None:
                best = self.plan(run.path())
        return best, spent

    def _answer(self, best: Plan | None, run: SolverRun) -> SearchResult:
        spent = run.spent + run.expansions
        if run.status in (PROVEN, EMPTY):
            if best is None:
                return SearchResult(None, 0, Proof.EXHAUSTED, PLANNER, spent, unsolvable=True)
            return SearchResult(best, len(best), Proof.HEURISTIC, PLANNER, spent)
        bound = min(run.promise, run.cut, PROMISES if best is None else len(best))
        return SearchResult(best, bound, Proof.HEURISTIC, PLANNER, spent)

    def plan(self, path: list[list[int]]) -> Plan:
        """A path of compact actions as a plan of the world."""
        row = list(self.code)
        return decode(self.model, self.start, row, path)


class SolverRun:
    """One pass of A* with a weight, in slices, within limits."""

    def __init__(
        self, search: KitchenSearch, weight: int, limits: Limits, watch: Watch | None
    ) -> None:
        self.search, self.weight, self.limits, self.watch = search, weight, limits, watch
        self.spent = 0
        self.status = PAUSED
        k, g = search.model.kitchen, search.goals
        self.players = int(k[PLAYERS])
        self.room = 2 * margin(self.players)
        while self.room < 4 * g[ROWS]:
            self.room *= 2
        self.nodes: Nodes = new_nodes(k, self.room)
        for row in range(g[ROWS]):
            state = list(search.code)
            state[ROOT] = row
            push(k, g, self.nodes, ints(state), -1, 0, 0, weight)

    @property
    def over(self) -> bool:
        """Whether the limits allow nothing at all."""
        if self.limits.stop is not None and self.limits.stop():
            return True
        return self.limits.expansions == 0

    @property
    def expansions(self) -> int:
        return int(self.nodes.notes[EXPANDED])

    @property
    def promise(self) -> int:
        return int(self.nodes.notes[PROMISE])

    @property
    def cut(self) -> int:
        return int(self.nodes.notes[CUT])

    @property
    def best(self) -> int | None:
        return int(self.nodes.notes[BEST]) if self.nodes.notes[GOAL] >= 0 else None

    def improve_on(self, length: int) -> None:
        """Leave out what is not shorter than a known plan."""
        self.nodes.notes[BEST] = length

    def go(self, expansions: int | None) -> None:
        """Go on for so many expansions, or to the end, or to the limits."""
        until = None if expansions is None else self.expansions + expansions
        while self.status in UNDECIDED:
            allowed = self._allowed(until)
            if allowed <= 0 or (self.limits.stop is not None and self.limits.stop()):
                self.status = PAUSED
                return
            self.status = run(
                self.search.model.kitchen, self.search.goals, self.nodes, self.weight, allowed
            )
            if self.watch is not None:
                self.watch(self.spent + self.expansions, self.promise, self.best)
            if self.status == GROW and not self._grow():
                return
            if self.weight > EXACT and self.best is not None:
                return

    def _allowed(self, until: int | None) -> int:
        allowed = SLICE[self.players - 1]
        if until is not None:
            allowed = min(allowed, until - self.expansions)
        if self.limits.expansions is not None:
            allowed = min(allowed, self.limits.expansions - self.spent - self.expansions)
        return allowed

    def _grow(self) -> bool:
        most = self.limits.states
        if most is not None and self.nodes.notes[COUNT] >= most:
            return False
        self.room *= 2
        self.nodes = new_nodes(self.search.model.kitchen, self.room, self.nodes)
        return True

    def path(self) -> list[list[int]]:
        """The joint actions that lead to the best goal found."""
        node = int(self.nodes.notes[GOAL])
        joints: list[list[int]] = []
        while self.nodes.parent[node] >= 0:
            joints.append(list(_joint(int(self.nodes.action[node]), self.players)))
            node = int(self.nodes.parent[node])
        return joints[::-1]


def _joint(packed: int, players: int) -> Iterator[int]:
    """The actions of a node in their order, each with its player's number times 2²⁰ added."""
    if players == 1:
        yield packed
        return
    for turn in range(players):
        p = packed >> ORDER + 2 * turn & 3
        action = packed >> BITS * p & (1 << BITS) - 1
        if action != WAIT:
            yield action + (p << 20)
