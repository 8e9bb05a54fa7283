"""One function for all searches, and the anytime planner, whose plans improve with time.

    anytime = AnytimePlanner(world)
    for answer in anytime.search(world.initial, Limits(expansions=500)):
        ...  # each is better than the one before

Work is measured in expansions, not seconds, so results are the same on every machine.
"""

from __future__ import annotations

import warnings
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from enum import StrEnum
from functools import cached_property
from math import ceil
from typing import Generic, NamedTuple, TypeVar

from robotouille.domain.task import Timing
from robotouille.errors import PluginError, RobotouilleError, WrongArgumentError
from robotouille.planning.beam.planner import EXPANSIONS, PLANNER, BeamPlanner, Solution
from robotouille.planning.plan import (
    UNLIMITED,
    Limits,
    Plan,
    Proof,
    SearchResult,
    Watch,
    eliminate_actions,
)
from robotouille.planning.plugins import AnytimeSearch, DomainPlanner, domain_planner
from robotouille.planning.search.best_first import astar_search, greedy_search
from robotouille.planning.search.unsolvable import ReachabilityCheck
from robotouille.world.timers import TimerRow
from robotouille.world.world import State, World

MAX_KEPT = 256
"""Maximum number of cached plans of general searches."""

# LM-cut of a state takes the time of 10 to 60 expansions, and the failed beam search has used
# UNSOLVED_FACTOR times the requested ones. So the greedy search takes about as long, or up to four
# times as long.
EXPANSIONS_PER_STATE = 4
"""Expansions of the failed beam search for each state that the greedy search may keep."""

T = TypeVar("T")

Stop = Callable[[], bool] | None


class Search(StrEnum):
    """Kind of search.

    `OPTIMAL`: the shortest plan with proof, by the domain's plug-in or by A*. `ANYTIME`: a good
    plan quickly, the last one of `AnytimePlanner.search`. `BEAM`: a plan by beam search, without
    proof.
    """

    OPTIMAL = "optimal"
    ANYTIME = "anytime"
    BEAM = "beam"


def solve(
    world: World,
    start: State | None = None,
    *,
    search: Search | str = Search.OPTIMAL,
    limits: Limits = UNLIMITED,
    watch: Watch | None = None,
) -> SearchResult:
    """Return a plan from a state, by default the initial one, in which all players act together.

    Equal arguments give equal results, unless `limits.stop` ends the search.

    Args:
        start: A state of this world.
        search: `optimal`, `anytime` or `beam`. An anytime plan ignores the timing profile: see
            `AnytimePlanner`.
        limits: Limits of the search. A beam search only uses `expansions`, whose default takes
            about half a second, and `stop`.
        watch: Callback of an optimal search.

    Returns:
        The best plan found, or None, and a proven lower bound on the length of every plan.

    Raises:
        PluginError: An installed plug-in cannot be loaded.
        WrongArgumentError: The search is unknown.
        RobotouilleError: The task is a shift, which has no goal.
    """
    check_has_goal(world)
    state = world.initial if start is None else start
    if search == Search.ANYTIME:
        *_, result = AnytimePlanner(world).search(state, limits)
        return result
    if search == Search.BEAM:
        return _beam(world, state, limits)
    if search != Search.OPTIMAL:
        names = ", ".join(map(repr, map(str, Search)))
        raise WrongArgumentError(f"expected one of {names}, found {search!r}")
    planner = domain_planner(world)
    found = planner.solve(world, state, limits, watch) if planner is not None else None
    return found or astar_search(world, state, limits=limits, watch=watch)


def check_has_goal(world: World) -> None:
    """Raise RobotouilleError if a task is a shift, which has no goal."""
    if world.shift is not None:
        raise RobotouilleError(
            f"{world.task.name} is a shift, which has no goal; plan its dishes one by one with "
            "robotouille.planning.shift.DishPlanner"
        )


def _beam(world: World, start: State, limits: Limits) -> SearchResult:
    expansions = EXPANSIONS if limits.expansions is None else limits.expansions
    found = BeamPlanner(world).solve(start, expansions=expansions, stop=limits.stop)
    plan = found.plan if found.reached else None
    return SearchResult(plan, 0, Proof.NONE, PLANNER, found.expansions)


class _Query(NamedTuple):
    """The arguments of a general search."""

    start: State
    team: tuple[str, ...]
    seed: int
    expansions: int
    choices: int = 1
    brief: bool = False


class _Recent(Generic[T]):
    """A cache of the results of recent queries."""

    def __init__(self) -> None:
        self._answers: OrderedDict[_Query, T] = OrderedDict()

    def get(self, query: _Query, search: Callable[[], T], stop: Stop) -> T:
        """Return the cached result, or the result of a search, which may be stopped."""
        if query not in self._answers:
            found = search()
            if stop is not None and stop():
                return found  # A search with more time would find more.
            self._answers[query] = found
            if len(self._answers) > MAX_KEPT:
                self._answers.popitem(last=False)
        self._answers.move_to_end(query)
        return self._answers[query]


class AnytimePlanner:
    """Planner for play from any state of one world.

    Plans are plans of `model`: the world itself, or the same task with the delays of the problem
    and walks of one step. A plan is an order of actions and is good under any timing. `searches`
    counts the cached beam searches.
    """

    def __init__(self, world: World) -> None:
        check_has_goal(world)
        task = world.task
        profile = task.profile
        plain = not profile.steps_per_tile and profile.repeat_steps == 1
        self.model = world if plain else World(replace(task, timing=Timing.BENCHMARK))
        self.forget()

    def forget(self) -> None:
        """Clear all caches. Results stay the same."""
        self.searches = 0
        self._planner = BeamPlanner(self.model)
        self._cut_off = ReachabilityCheck(self.model)
        self._solutions: _Recent[Solution] = _Recent()
        self._greedy: _Recent[SearchResult] = _Recent()

    def in_model(self, state: State) -> State:
        """Return a state of the task with any timing as a state of the model.

        The rest of a delay is converted into the model's shorter steps.

        Raises:
            UnknownNameError: The state is of another task, with other objects.
            WrongWorldError: The facts or timers cannot be of this task.
        """
        if state.world is self.model:
            return state
        rows = state.timer_rows()
        if state.world.task.timing is not Timing.BENCHMARK:
            rows = _shortened(state)
        return self.model.restore(state.facts, rows)

    def is_cut_off(self, state: State, team: Collection[str]) -> bool:
        """Return whether a team provably cannot reach the goal while all others stand still."""
        return self._cut_off(self.in_model(state), team)

    def first(
        self, state: State, limits: Limits = UNLIMITED, *, team: Sequence[str] = (), seed: int = 0
    ) -> SearchResult:
        """Return the first plan of `search`, quickly; it is seldom the shortest."""
        return next(self.search(state, limits, team=team, seed=seed))

    def search(
        self,
        state: State,
        limits: Limits = UNLIMITED,
        *,
        team: Sequence[str] = (),
        seed: int = 0,
        beam: int = EXPANSIONS,
        choices: int = 1,
        brief: bool = False,
    ) -> Iterator[SearchResult]:
        """Yield plans for the players of `team` (by default all), while the others do nothing.

        Each result has a shorter plan or a better bound than the one before. If a plug-in knows the
        domain and all players plan, the first plan is the plug-in's quick plan, if any, and the
        second one is its best within the limits. Otherwise the plan comes from beam search, without
        proof. If no plug-in knows the domain and the beam search fails, greedy best-first search
        follows. The general searches also run last if the plug-in finds nothing and `beam` is not
        0. A plug-in that cannot be loaded is ignored with a warning.

        Args:
            state: A state of the task with any timing.
            limits: Limits of the plug-in's search. All searches use `stop`.
            seed: Seed of the beam search. Other seeds lead to other plans.
            beam: Approximate number of expansions of a beam search.
            choices: Choices of objects for the goal that a beam search tries if the first has no
                plan, for example because a player stands in its way.
            brief: Try all choices in turns in one search, so that all take no longer than one
                search.

        Yields:
            The result so far. Its `plan` may be None.

        Raises:
            UnknownNameError: The state is of another task, with other objects.
            WrongWorldError: The facts or timers cannot be of this task.
        """
        start = self.in_model(state)
        search = self._domain_search(start, team)
        at_once = search.greedy(limits) if search is not None else None
        query = _Query(start, tuple(sorted(team)), seed, beam, choices, brief)
        result = at_once or self._general(query, limits.stop)
        yield result
        if search is None or result.optimal or result.unsolvable:
            return
        better = _joined(result, search.improve(result.plan, limits))
        if at_once is not None and better.plan is None and not better.unsolvable and beam:
            better = _joined(better, self._general(query, limits.stop))
        yield better

    def analyse(self, state: State, *, choices: int = 1, parts: int) -> int:
        """Analyse at most `parts` parts of goals for beam searches from a state.

        Return the number of new parts. If it is less than `parts`, the analysis is complete.
        """
        return self._planner.analyse(self.in_model(state), choices, parts)

    def towards(
        self,
        state: State,
        *,
        team: Sequence[str] = (),
        seed: int = 0,
        beam: int = EXPANSIONS,
        choices: int = 1,
        brief: bool = False,
    ) -> Plan:
        """Return the plan that leads as near to the goal as the beam search gets.

        Arguments are those of `search`.
        """
        team = tuple(sorted(team))
        query = _Query(self.in_model(state), team, seed, beam, choices, brief)
        return self._beam_search(query, None).plan

    @cached_property
    def _domain_planner(self) -> DomainPlanner | None:
        """The domain's plug-in. If it is broken, play continues with the general planners."""
        try:
            return domain_planner(self.model)
        except PluginError as error:
            warnings.warn(f"{error}; the general planners take over", stacklevel=2)
            return None

    def _domain_search(self, start: State, team: Sequence[str]) -> AnytimeSearch | None:
        """Return the search of the domain's plug-in if all players plan."""
        if team and not set(team).issuperset(self.model.players):
            return None
        planner = self._domain_planner
        return None if planner is None else planner.anytime(self.model, start)

    def _general(self, query: _Query, stop: Stop) -> SearchResult:
        """Return a plan by beam search, or by greedy search."""
        solution = self._beam_search(query, stop)
        plan = solution.plan if solution.reached else None
        result = SearchResult(plan, 0, Proof.NONE, PLANNER, solution.expansions)
        # In a domain without a plug-in, the beam search's heuristic may miss what matters. But in a
        # shift, the greedy search takes 10 to 50 s, for which no game waits.
        if plan is not None or query.brief or self._domain_planner is not None:
            return result
        greedy = self._greedy_search(query, stop)
        return replace(greedy, expansions=solution.expansions + greedy.expansions)

    def _beam_search(self, query: _Query, stop: Stop) -> Solution:
        def solve(choices: int) -> Solution:
            return self._planner.solve(
                query.start,
                query.team,
                seed=query.seed,
                expansions=query.expansions,
                choices=choices,
                stop=stop,
            )

        def search() -> Solution:
            self.searches += 1
            found = solve(query.choices if query.brief else 1)
            if found.reached or query.choices == 1 or query.brief:
                return found
            other = solve(query.choices)
            return other if other.reached else found

        return self._solutions.get(query, search, stop)

    def _greedy_search(self, query: _Query, stop: Stop) -> SearchResult:
        def search() -> SearchResult:
            limits = Limits(states=query.expansions // EXPANSIONS_PER_STATE, stop=stop)
            found = greedy_search(self.model, query.start, team=query.team, limits=limits)
            if found.plan is None:
                return found
            return replace(found, plan=eliminate_actions(found.plan, query.start))

        return self._greedy.get(query, search, stop)


def _joined(old: SearchResult, new: SearchResult) -> SearchResult:
    """Combine two results of one query."""
    plans = [a.plan for a in (old, new) if a.plan is not None]
    shortest = min(plans, key=len, default=None)
    stronger = new if new.bound >= old.bound else old
    return replace(
        stronger,
        plan=shortest,
        planner=new.planner if shortest is new.plan else old.planner,
        expansions=old.expansions + new.expansions,
        unsolvable=old.unsolvable or new.unsolvable,
    )


def _shortened(state: State) -> tuple[TimerRow, ...]:
    """Return the timers of a state as if it had the delays of the problem."""
    factor = state.world.task.profile.delay_factor
    rows = []
    for effect, progress in state.timers.entries:
        counters = list(progress)
        for node in effect.counters():
            if node.counts == "steps" and 0 <= counters[node.slot] < node.total:
                total = (node.total - 1) // factor + 1
                left = ceil((node.total - counters[node.slot]) / factor)
                counters[node.slot] = max(0, total - left)
        rows.append((*effect.label, tuple(counters)))
    return tuple(rows)
