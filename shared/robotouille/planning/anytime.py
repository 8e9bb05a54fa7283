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
from robotouille.planners.kitchen.compact_state import PLACE, PLAYERS, ROOT, ROWS, WAIT, WORDS
from robotouille.planners.kitchen.goal_assignments import TooManyChoicesError
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
from robotouille.planners.kitchen.solver import PLANNER, KitchenSearch, SolverRun, kitchen_search
from robotouille.planners.kitchen.transitions import act, options, running, spot, tick, unpack
from robotouille.planning.beam.planner import EXPANSIONS, Planner, Solution
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import UNLIMITED, Limits, Proof, SearchResult
from robotouille.planning.validation import replay
from robotouille.world.state import State
from robotouille.world.world import World

__all__ = ["Anytime"]

BEAM = "beam 1"

DEEPEST = 2_000
"""Expansions after which a dive is given up."""

KEPT = 256
"""Plans by beam search that are kept: whoever asks the same again is answered at once."""

MAX_PLAYERS = 2
"""Larger teams have too many joint actions for a search that tries all of them."""

NEAR = 1.05
"""By how much a plan may be longer than what is proven before another is sought for a team."""

EXACT, BOLD = 4, 6
"""Weights of the estimate, in quarters: shortest plans, and those for which teams have time."""


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

        Each is shorter than the one before, or more is proven about it. A player who is alone in
        a kitchen has a plan at once, then the shortest that is found within the limits. Others
        (and that player at last, if nothing else helps and `beam` is not 0) have one by beam
        search, of as many expansions as `beam`; the limits are for a second search by two in a
        kitchen. A beam search proves nothing.
        """
        start = self.in_model(state)
        search = self._kitchen(start, team)
        alone = search is not None and search.model.kitchen[PLAYERS] == 1
        first = dive(search, limits) if search is not None and alone else None
        answer = first or self._beam(start, team, seed, beam)
        yield answer
        if search is None or answer.optimal or answer.unsolvable:
            return
        more = search.solve(limits) if alone else _bold(search, answer.plan, limits)
        better = _joined(answer, more)
        if better.plan is None and not better.unsolvable and alone and beam:
            better = _joined(better, self._beam(start, team, seed, beam))
        yield better

    def towards(
        self, state: State, *, team: Sequence[str] = (), seed: int = 0, beam: int = EXPANSIONS
    ) -> Plan:
        """What leads as near to the goal as the beam search gets, where it gets no further."""
        return self._beam_search(self.in_model(state), team, seed, beam).plan

    def _kitchen(self, start: State, team: Sequence[str]) -> KitchenSearch | None:
        players = self.model.players
        if len(players) > MAX_PLAYERS or (team and not set(team).issuperset(players)):
            return None
        try:
            return kitchen_search(self.model, start)
        except TooManyChoicesError:
            return None

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
            if len(self._solutions) > KEPT:
                self._solutions.popitem(last=False)
        self._solutions.move_to_end(asked)
        return found


def dive(search: KitchenSearch, limits: Limits = UNLIMITED) -> SearchResult:
    """A plan for a player who is alone, by always going on from the best successor.

    The first successor that gives nothing away is good enough, so most are never looked at. Where
    there is none at all, it goes back to the best state that was left, if any. The bound is the
    estimate at the start.
    """
    k, x = search.model.kitchen, _roots(search)
    if x.notes[PROMISE] == PROMISES and x.notes[GOAL] < 0:
        nothing = x.notes[CUT] == PROMISES
        proof = Proof.EXHAUSTED if nothing else Proof.NONE
        return SearchResult(None, 0, proof, PLANNER, 0, unsolvable=bool(nothing))
    bound = 0 if x.notes[GOAL] >= 0 else int(x.notes[PROMISE])
    most = DEEPEST if limits.expansions is None else min(limits.expansions, DEEPEST)
    node, spent = pop(x), 0
    while node >= 0 and x.notes[GOAL] < 0 and spent < most:
        spent += 1
        if x.notes[COUNT] + margin(1) > len(x.steps):
            x = new_nodes(k, 2 * len(x.steps), x)
        node = _best_successor(k, search.goals, x, node)
        if node < 0:
            node = pop(x)
    plan = _to_the_goal(search, _path(x)) if x.notes[GOAL] >= 0 else None
    return SearchResult(plan, bound, Proof.HEURISTIC, PLANNER, spent)


def _to_the_goal(search: KitchenSearch, path: list[list[int]]) -> Plan:
    """The plan of a path, without what comes after the goal: time may bring it on a last walk."""
    plan = search.plan(path)
    return Plan(plan.steps[: replay(plan, search.model.world, search.start).reached_at])


def _roots(search: KitchenSearch) -> Nodes:
    """The start, once for each choice of objects."""
    k, g = search.model.kitchen, search.goals
    x = new_nodes(k, 1 << max(4 * margin(1), 2 * g[ROWS]).bit_length())
    for row in range(g[ROWS]):
        state = list(search.code)
        state[ROOT] = row
        push(k, g, x, ints(state), -1, 0, 0, EXACT)
    return x


def _best_successor(k: Ints, g: Ints, x: Nodes, node: int) -> int:
    """Of the new successors the one with the least promise, then the nearest to the goal; -1 if
    none is new. No others are made once there is one with the promise of the state itself."""
    first, promise = x.notes[COUNT], x.steps[node] + x.estimate[node]
    unpack(k, x.key, node * k[WORDS], x.s)
    for action, steps in _successors(k, g, x):
        before = x.notes[COUNT]
        push(k, g, x, x.t, node, action, x.steps[node] + steps, EXACT)
        if x.notes[GOAL] >= 0:
            break
        new = x.notes[COUNT] - 1
        if new >= before and x.steps[new] + x.estimate[new] <= promise:
            break
    news = range(first, x.notes[COUNT])
    return min(news, key=lambda i: (x.steps[i] + x.estimate[i], x.estimate[i]), default=-1)


def _successors(k: Ints, g: Ints, x: Nodes) -> Iterator[tuple[int, int]]:
    """What follows on the state in `x.s`, one after the other in `x.t`: the action and its steps.

    First what is done here, then what is done elsewhere, which takes a step to walk there; waiting
    comes last.
    """
    for action in list(x.acts[: options(k, g, x.s, 0, True, x.acts, 0)]):
        copy(k, x.s, x.t)
        act(k, x.t, 0, action)
        tick(k, x.t)
        yield action, 1
    copy(k, x.s, x.u)
    tick(k, x.u)
    for action in list(x.acts[: options(k, g, x.u, 0, False, x.acts, 0)]):
        copy(k, x.u, x.t)
        x.t[k[PLACE]] = spot(k, x.t, action)
        act(k, x.t, 0, action)
        tick(k, x.t)
        yield action, 2
    if running(k, x.s):
        copy(k, x.u, x.t)
        yield WAIT, 1


def _path(x: Nodes) -> list[list[int]]:
    """The actions that lead to the goal that was found."""
    node, actions = int(x.notes[GOAL]), []
    while x.parent[node] >= 0:
        actions.append([int(x.action[node])])
        node = int(x.parent[node])
    return actions[::-1]


def _bold(search: KitchenSearch, known: Plan | None, limits: Limits) -> SearchResult:
    """Another plan for a team, unless a known one is near to what an estimate proves.

    What does not promise to better that one is not left out: then the search would look in many
    more places, and find less.
    """
    run = SolverRun(search, BOLD, limits, None)
    bound = min(run.nodes.estimate[: run.nodes.notes[COUNT]], default=0)
    plan = None
    if known is None or len(known) > NEAR * bound:
        run.go(None)
        plan = search.plan(run.path()) if run.best is not None else None
    return SearchResult(plan, int(bound), Proof.HEURISTIC, PLANNER, run.expansions)


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
