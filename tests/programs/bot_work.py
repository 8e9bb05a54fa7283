"""Work that bots could do in a state of their game, and the times in which they did nothing.

A bot has useful work in a state if it alone, while everybody else stands still, could

1. reach the goal by a plan that begins at once, without waiting for a running effect, or
2. come nearer to the goal: after all work that is possible now, fewer actions are left than before.
   In a shift, no other open order may need more actions than before.

So no work counts that needs anybody to step aside, to put something down or to help. A bot stands
still if it has useful work for ten seconds, without a break, and does nothing. A person who wanders
through the kitchen opens and closes ways again and again, too briefly for bots that need seconds
to react.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from functools import cached_property, partial
from typing import NamedTuple

from robotouille import State, World
from robotouille.domain.task import Task
from robotouille.planning.plan import Plan
from robotouille.planning.policies.aside import after, put_down, with_others_aside
from robotouille.planning.policies.deferral import after_possible
from robotouille.planning.policies.policy import does_something
from robotouille.planning.policies.standing import walk_to
from robotouille.planning.shift import DishPlanner
from robotouille.planning.solvers import AnytimePlanner
from tests.programs.simulated_people import RATE
from tests.support.team_games import TeamGame

STANDSTILL = int(10 * RATE)
"""Steps without an action from which a bot stands still."""
LOOK = int(2 * RATE)
"""Steps between two looks for work in a time without an action."""
CAREFUL, QUICK = 8_000, 1_000
"""Expansions of the searches for careful plans, and of each of the many searches for work."""

Team = tuple[str, ...]


class Kitchen:
    """One kitchen and the work of teams in it. Several games share the analysis of its task."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.world = World(task)
        self._dishes: dict[str, AnytimePlanner] = {}

    @cached_property
    def anytime(self) -> AnytimePlanner:
        return AnytimePlanner(World(self.task))

    def _dish(self, name: str) -> AnytimePlanner:
        if name not in self._dishes:
            self._dishes[name] = DishPlanner(self.world, name).anytime
        return self._dishes[name]

    def plan(self, state: State, team: Team) -> tuple[Plan, State] | None:
        """Return a careful plan of a team for the goal, and its first state; None without one."""
        start = self.anytime.in_model(state)
        if self.is_cut_off(start, team):
            return None  # Without a plan, the search takes seconds, the proof a tenth of one.
        *_, found = self.anytime.search(start, team=team, beam=CAREFUL, choices=6)
        return None if found.plan is None else (found.plan, start)

    def is_cut_off(self, state: State, team: Team) -> bool:
        """Return whether a team provably cannot reach the goal while all others stand still."""
        return self.anytime.is_cut_off(state, team)

    def work(self, state: State, bot: str) -> str:
        """Return the useful work of a bot: all up to the goal, some of it, or nothing."""
        team = (bot,)
        goals = list(self._goals(state))
        found = [_work(anytime, state, team) for anytime in goals]
        if any(each.reaches_goal for each in found):
            return "goal"
        for goal, each in zip(goals, found, strict=True):
            others = [other for other in goals if other is not goal]
            if each.later and all(_keeps_near(o, state, each.later, team) for o in others):
                return "work"
        return ""

    def _goals(self, state: State) -> Iterator[AnytimePlanner]:
        if self.world.shift is None or state.orders is None:
            yield self.anytime
            return
        for name in sorted({self.world.shift.dish_name(each.number) for each in state.orders.open}):
            yield self._dish(name)


class Standstill(NamedTuple):
    """Steps in which a bot did nothing: the first one, their number, and the possible work."""

    bot: str
    start: int
    steps: int
    work: str


def states(world: World, game: TeamGame) -> list[State]:
    """Return the state before each step of a game, and the last one."""
    found = [world.initial]
    for did in game.steps:
        found.append(found[-1].step([action for _, action, applied in did if applied]).state)
    return found


def standstills(kitchen: Kitchen, bots: Sequence[str], game: TeamGame) -> list[Standstill]:
    """Return all times in which a bot did nothing for ten seconds while an order was open.

    Their `work` is the useful work that the bot had in ten of these seconds, without a break.
    """
    found: list[Standstill] = []
    before = states(kitchen.world, game)
    for bot in bots:
        for start, steps in _idle_times(bot, before, game):
            if steps >= STANDSTILL:
                work = _lasting_work(kitchen, bot, before[start : start + steps + 1 : LOOK])
                found.append(Standstill(bot, start, steps, work))
    return found


def _lasting_work(kitchen: Kitchen, bot: str, looks: Sequence[State]) -> str:
    """Return the useful work of a bot in ten seconds of its looks at the kitchen, or nothing."""
    # A moment without work excludes all ten seconds around it, so the last moment comes first.
    last = STANDSTILL // LOOK
    while last < len(looks):
        for number in range(last, last - STANDSTILL // LOOK - 1, -1):
            work = kitchen.work(looks[number], bot)
            if not work:
                last = number + STANDSTILL // LOOK + 1
                break
        else:
            return work
    return ""


def idle_steps(world: World, bots: Sequence[str], game: TeamGame) -> list[int]:
    """Return for each bot the longest time in steps without an action while an order is open."""
    before = states(world, game)
    return [max((n for _, n in _idle_times(bot, before, game)), default=0) for bot in bots]


def _idle_times(bot: str, before: Sequence[State], game: TeamGame) -> Iterator[tuple[int, int]]:
    """Yield the first step and the number of steps of each time without an action."""
    idle = 0
    for number, did in enumerate(game.steps):
        state = before[number]
        acted = any(p == bot and applied and does_something(a) for p, a, applied in did)
        unordered = state.orders is not None and not state.orders.open
        if acted or unordered or state.busy_steps(bot):
            if idle:
                yield number - idle, idle
            idle = 0
        else:
            idle += 1
    if idle:
        yield len(game.steps) - idle, idle


class _Work(NamedTuple):
    """The useful work for a goal, and the state after work that comes nearer to the goal."""

    reaches_goal: bool = False
    later: State | None = None


def _work(anytime: AnytimePlanner, state: State, team: Team) -> _Work:
    state = anytime.in_model(state)
    plan = _leanest(anytime, state, team)
    if plan is not None:
        return _Work(reaches_goal=_begins_at_once(plan, state))
    others = _others(state, team)
    # An object in hand may keep a bot from all other work. To put it down is no progress yet.
    fewest = sys.maxsize
    for bot in (*team, ""):
        here = _relieved(state, bot)
        if here is None:
            continue
        aside = with_others_aside(here, others)
        plan = _leanest(anytime, aside, team)
        if plan is None:
            continue
        needed = _deeds(plan) if bot else min(_deeds(plan), fewest - 1)
        fewest = min(fewest, needed)
        later = after_possible(plan, aside, here, team)
        rest = _leanest(anytime, with_others_aside(later, others), team)
        if rest is not None and _deeds(rest) < needed:
            return _Work(later=later)
    return _Work()


def _keeps_near(anytime: AnytimePlanner, before: State, later: State, team: Team) -> bool:
    """Return whether a goal needs no more actions later if the others step aside."""
    here, there = (
        _leanest(anytime, with_others_aside(anytime.in_model(state), _others(state, team)), team)
        for state in (before, later)
    )
    return here is None or (there is not None and _deeds(there) <= _deeds(here))


def _others(state: State, team: Team) -> list[str]:
    return [p for p in state.world.players if p not in team]


def _begins_at_once(plan: Plan, state: State) -> bool:
    """Return whether the first action other than a walk needs no running effect to end."""
    for joint in plan:
        for action in joint:
            if action.destination is None:
                return state.world.applicable(state, action)
            walk = walk_to(state, action.player or "", action.destination)
            state = state if walk is None else after(state, walk)
    return False


def _leanest(anytime: AnytimePlanner, state: State, team: Team) -> Plan | None:
    """Return the plan with the fewest actions other than walks of a few plans."""
    if anytime.is_cut_off(state, team):
        return None
    search = partial(anytime.search, state, team=team, beam=QUICK, choices=6, brief=True)
    plans = [next(search(seed=seed)).plan for seed in range(4)]
    return min((plan for plan in plans if plan is not None), key=_deeds, default=None)


def _deeds(plan: Plan) -> int:
    """Return the number of actions other than walks."""
    return sum(action.destination is None for joint in plan for action in joint)


def _relieved(state: State, player: str) -> State | None:
    """Return a state after a player has put down everything, or None if that is impossible."""
    actions = put_down(state, player) if player else ()
    for action in actions:
        state = after(state, action)
    return state if actions or not player else None
