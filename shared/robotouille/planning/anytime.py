"""Plans for play: one at once, and better ones while there is time.

anytime = AnytimePlanner(world)
for answer in anytime.search(world.initial, Limits(expansions=500)):
    ...  # each is better than the one before

Work is counted in expansions, never in seconds: one question has the same answers everywhere.
"""

from __future__ import annotations

import warnings
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from math import ceil
from typing import Generic, NamedTuple, TypeVar

from robotouille.domain.task import Timing
from robotouille.errors import PluginError
from robotouille.planning.beam.planner import EXPANSIONS, PLANNER, BeamPlanner, Solution
from robotouille.planning.plan import Plan
from robotouille.planning.plugins import AnytimeSearch, DomainPlanner, domain_planner
from robotouille.planning.repair.action_elimination import eliminate_actions
from robotouille.planning.search.greedy import greedy_search
from robotouille.planning.search.unsolvable import CutOff
from robotouille.planning.search_result import UNLIMITED, Limits, Proof, SearchResult
from robotouille.world.timers import TimerRow
from robotouille.world.world import State, World

__all__ = ["AnytimePlanner"]

MAX_KEPT = 256
"""Plans by general searches that are kept."""

EXPANSIONS_PER_STATE = 4
"""Greedy search may keep a state for so many expansions that the beam search before it was asked
for; that has made `UNSOLVED_FACTOR` times as many in vain. LM-cut of a state takes the time of 10
to 60 of those, so greedy search takes about as long, or up to four times that."""

T = TypeVar("T")


class _Query(NamedTuple):
    """What a general search is asked."""

    start: State
    team: tuple[str, ...]
    seed: int
    expansions: int
    choices: int = 1
    brief: bool = False


class _Recent(Generic[T]):
    """The answers to the last queries: the same one is answered at once."""

    def __init__(self) -> None:
        self._answers: OrderedDict[_Query, T] = OrderedDict()

    def get(self, query: _Query, search: Callable[[], T]) -> T:
        """The answer that is known, or what a search finds."""
        if query not in self._answers:
            self._answers[query] = search()
            if len(self._answers) > MAX_KEPT:
                self._answers.popitem(last=False)
        self._answers.move_to_end(query)
        return self._answers[query]


class AnytimePlanner:
    """Plans in one world, from any of its states.

    They are plans of `model`: the world itself, or one of the same task in which nothing takes
    longer than the problem says. A plan is an order of actions, and good under any timing.
    `searches` counts the beam searches from which something is remembered.
    """

    def __init__(self, world: World) -> None:
        task = world.task
        profile = task.profile
        plain = not profile.steps_per_tile and profile.repeat_steps == 1
        self.model = world if plain else World(replace(task, timing=Timing.BENCHMARK))
        self.forget()

    def forget(self) -> None:
        """Remember nothing of what was found out so far; the answers stay the same."""
        self.searches = 0
        self._planner = BeamPlanner(self.model)
        self._cut_off = CutOff(self.model)
        self._solutions: _Recent[Solution] = _Recent()
        self._greedy: _Recent[SearchResult] = _Recent()

    def in_model(self, state: State) -> State:
        """A state of the task, of whatever timing, as one of the model.

        What is left of a delay is left of it in the model, in the model's shorter steps.

        Raises:
            UnknownNameError: The state is one of another task, with objects that this has not.
            WrongWorldError: Its facts or timers cannot be of this task.
        """
        if state.world is self.model:
            return state
        rows = state.timer_rows()
        if state.world.task.timing is not Timing.BENCHMARK:
            rows = _shortened(state)
        return self.model.restore(state.facts, rows)

    def is_cut_off(self, state: State, team: Collection[str]) -> bool:
        """Whether it is proven that a team cannot reach the goal while all others stand still."""
        return self._cut_off(self.in_model(state), team)

    def first(
        self, state: State, limits: Limits = UNLIMITED, *, team: Sequence[str] = (), seed: int = 0
    ) -> SearchResult:
        """The first plan: at once, and seldom the shortest. Arguments are those of `search`."""
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
        """Plans for the players of `team` (all, if empty), the others doing nothing.

        Each is shorter than the one before, or more is proven about it. Where a plug-in knows the
        domain and all players are to plan, the first plan is the plug-in's, if it has one at once,
        and the second one is what it finds within the limits. Else (and at last, if that found
        nothing and `beam` is not 0) there is one by beam search, which proves nothing; and where
        no plug-in knows the domain and that search finds nothing, by greedy best-first search.
        A plug-in that cannot be loaded is left out, with a warning.

        Args:
            state: One of the task, of whatever timing.
            limits: Those of the plug-in's search.
            seed: Another one leads a beam search to other plans.
            beam: About how many expansions a beam search takes.
            choices: Of objects for the goal that a beam search tries where the first has no plan:
                somebody may stand where that one is.
            brief: Try all of these in one search, in turns, and not the first by itself before: so
                all of it takes no more than one search.

        Yields:
            What is known so far; its `plan` is None where none was found.

        Raises:
            UnknownNameError: The state is one of another task, with objects that this has not.
            WrongWorldError: Its facts or timers cannot be of this task.
        """
        start = self.in_model(state)
        search = self._domain_search(start, team)
        at_once = search.greedy(limits) if search is not None else None
        query = _Query(start, tuple(sorted(team)), seed, beam, choices, brief)
        result = at_once or self._general(query)
        yield result
        if search is None or result.optimal or result.unsolvable:
            return
        better = _joined(result, search.improve(result.plan, limits))
        if at_once is not None and better.plan is None and not better.unsolvable and beam:
            better = _joined(better, self._general(query))
        yield better

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
        """What leads as near to the goal as the beam search gets, where it gets no further.

        Arguments are those of `search`.
        """
        team = tuple(sorted(team))
        query = _Query(self.in_model(state), team, seed, beam, choices, brief)
        return self._beam_search(query).plan

    @cached_property
    def _domain_planner(self) -> DomainPlanner | None:
        """Play goes on with the general planners where a plug-in is broken."""
        try:
            return domain_planner(self.model)
        except PluginError as error:
            warnings.warn(f"{error}; the general planners take over", stacklevel=2)
            return None

    def _domain_search(self, start: State, team: Sequence[str]) -> AnytimeSearch | None:
        """The search of the plug-in that knows the domain, if all players are to plan."""
        if team and not set(team).issuperset(self.model.players):
            return None
        planner = self._domain_planner
        return None if planner is None else planner.anytime(self.model, start)

    def _general(self, query: _Query) -> SearchResult:
        """A plan by beam search; if that finds none where no plug-in knows the domain, by greedy
        search: a beam search may be blind for what matters in a domain."""
        solution = self._beam_search(query)
        plan = solution.plan if solution.reached else None
        result = SearchResult(plan, 0, Proof.NONE, PLANNER, solution.expansions)
        if plan is not None or self._domain_planner is not None:
            return result
        greedy = self._greedy_search(query)
        return replace(greedy, expansions=solution.expansions + greedy.expansions)

    def _beam_search(self, query: _Query) -> Solution:
        def solve(choices: int) -> Solution:
            return self._planner.solve(
                query.start,
                query.team,
                seed=query.seed,
                expansions=query.expansions,
                choices=choices,
            )

        def search() -> Solution:
            self.searches += 1
            found = solve(query.choices if query.brief else 1)
            if found.reached or query.choices == 1 or query.brief:
                return found
            other = solve(query.choices)
            return other if other.reached else found

        return self._solutions.get(query, search)

    def _greedy_search(self, query: _Query) -> SearchResult:
        def search() -> SearchResult:
            limits = Limits(states=query.expansions // EXPANSIONS_PER_STATE)
            found = greedy_search(self.model, query.start, team=query.team, limits=limits)
            if found.plan is None:
                return found
            return replace(found, plan=eliminate_actions(found.plan, query.start))

        return self._greedy.get(query, search)


def _joined(old: SearchResult, new: SearchResult) -> SearchResult:
    """What two answers to one question say together."""
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
    """The timers of a state as they would be with the delays of the problem."""
    factor = state.world.task.profile.delay_factor
    rows = []
    for effect, progress in state.timers.entries:
        counters = list(progress)
        for node in effect.counters():
            if node.kind == "delayed" and 0 <= counters[node.slot] < node.total:
                total = (node.total - 1) // factor + 1
                left = ceil((node.total - counters[node.slot]) / factor)
                counters[node.slot] = max(0, total - left)
        rows.append((*effect.label, tuple(counters)))
    return tuple(rows)
