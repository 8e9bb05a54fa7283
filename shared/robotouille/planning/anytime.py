"""Plans for play: one at once, and better ones while there is time.

anytime = Anytime(world)
for answer in anytime.answers(world.initial, Limits(expansions=500)):
    ...  # each is better than the one before

Work is counted in expansions, never in seconds: one question has the same answers everywhere.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import ceil

from robotouille.domain.task import Timing
from robotouille.planning.beam.planner import EXPANSIONS, Planner, Solution
from robotouille.planning.plan import Plan
from robotouille.planning.plugins import AnytimeSearch, first_offer
from robotouille.planning.search_result import UNLIMITED, Limits, Proof, SearchResult
from robotouille.world.state import State
from robotouille.world.world import World

__all__ = ["Anytime"]

BEAM = "beam 1"

MAX_KEPT = 256
"""Plans by beam search that are kept: whoever asks the same again is answered at once."""

_Asked = tuple[State, tuple[str, ...], int, int]
"""A question to the beam search: state, team, seed and expansions."""


class Anytime:
    """Plans in one world, from any of its states.

    They are plans of `model`: the world itself, or one of the same task in which nothing takes
    longer than the problem says. A plan is an order of actions, and good under any timing.
    `searches` counts the beam searches from which something is remembered.
    """

    def __init__(self, world: World) -> None:
        task = world.task
        plain = task.timing is Timing.BENCHMARK
        self.model = world if plain else World(replace(task, timing=Timing.BENCHMARK))
        self.forget()

    def forget(self) -> None:
        """Remember nothing of what was found out so far; the answers stay the same."""
        self.searches = 0
        self._planner = Planner(self.model)
        self._solutions: OrderedDict[_Asked, Solution] = OrderedDict()

    def in_model(self, state: State) -> State:
        """A state of the task, of whatever timing, as one of the model.

        What is left of a delay is left of it in the model, in the model's shorter steps.
        """
        if state.world is self.model:
            return state
        rows = state.timer_rows()
        if state.world.task.timing is not Timing.BENCHMARK:
            rows = _shortened(state)
        return self.model.restore(state.facts, rows)

    def first(
        self, state: State, limits: Limits = UNLIMITED, *, team: Sequence[str] = (), seed: int = 0
    ) -> SearchResult:
        """The first plan: at once, and seldom the shortest."""
        return next(self.answers(state, limits, team=team, seed=seed))

    def answers(
        self,
        state: State,
        limits: Limits = UNLIMITED,
        *,
        team: Sequence[str] = (),
        seed: int = 0,
        beam: int = EXPANSIONS,
    ) -> Iterator[SearchResult]:
        """Plans for the players of `team` (all, if empty), the others doing nothing.

        Each is shorter than the one before, or more is proven about it. Where a plug-in knows the
        domain and all players are to plan, the first plan is the plug-in's, if it has one at once,
        and the second one is what it finds within the limits. Else (and at last, if that found
        nothing and `beam` is not 0) there is one by beam search, of as many expansions as `beam`,
        which proves nothing. Raises PluginError.
        """
        start = self.in_model(state)
        search = self._domain_search(start, team)
        greedy = search.greedy(limits) if search is not None else None
        result = greedy or self._beam(start, team, seed, beam)
        yield result
        if search is None or result.optimal or result.unsolvable:
            return
        better = _joined(result, search.improve(result.plan, limits))
        if greedy is not None and better.plan is None and not better.unsolvable and beam:
            better = _joined(better, self._beam(start, team, seed, beam))
        yield better

    def towards(
        self, state: State, *, team: Sequence[str] = (), seed: int = 0, beam: int = EXPANSIONS
    ) -> Plan:
        """What leads as near to the goal as the beam search gets, where it gets no further."""
        return self._beam_search(self.in_model(state), team, seed, beam).plan

    def _domain_search(self, start: State, team: Sequence[str]) -> AnytimeSearch | None:
        """The search of the plug-in that knows the domain, if all players are to plan."""
        if team and not set(team).issuperset(self.model.players):
            return None
        return first_offer(lambda planner: planner.anytime(self.model, start))

    def _beam(self, start: State, team: Sequence[str], seed: int, beam: int) -> SearchResult:
        found = self._beam_search(start, team, seed, beam)
        plan = found.plan if found.reached else None
        return SearchResult(plan, 0, Proof.NONE, BEAM, found.expansions)

    def _beam_search(self, start: State, team: Sequence[str], seed: int, beam: int) -> Solution:
        asked = (start, tuple(sorted(team)), seed, beam)
        found = self._solutions.get(asked)
        if found is None:
            self.searches += 1
            found = self._planner.solve(start, asked[1], seed=seed, expansions=beam)
            self._solutions[asked] = found
            if len(self._solutions) > MAX_KEPT:
                self._solutions.popitem(last=False)
        self._solutions.move_to_end(asked)
        return found


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


def _shortened(state: State) -> tuple[tuple[str, int, tuple[str, ...], tuple[int, ...]], ...]:
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
