"""Searches and plans of a team next to other participants.

Limits count expansions instead of seconds, so that all bots of a team find the same plan on every
machine (docs/decisions/0029-identical-team-plans.md).

A plan relies on the team alone, on others stepping aside, on others doing their part, or leads only
as near to the goal as possible (docs/decisions/0038-bots-with-people.md). In real time all searches
for one decision share MAX_BRIEF expansions, and a bot acts between its searches: see `Portion`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from enum import Enum, auto

from robotouille.planning.beam.planner import PLANNER, UNSOLVED_FACTOR
from robotouille.planning.plan import Limits, Plan, Proof, SearchResult
from robotouille.planning.policies.aside import after, held_by, holds, put_down, with_others_aside
from robotouille.planning.policies.deferral import defer_blocked, possible_part, who_can_begin
from robotouille.planning.policies.policy import Script
from robotouille.planning.policies.standing import leads_to, standing_at
from robotouille.planning.shift import CHOICES
from robotouille.planning.solvers import AnytimePlanner
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.work import Occupancy
from robotouille.world.unmet import UnmetKind
from robotouille.world.world import State

EXPANSIONS = 2_000
"""Expansions of the beam search for each plan of a team."""

# Expansions for a shorter plan: per decision for one player, or per plan for two. In plain Python
# they take about 0.1 s for one player and 0.5 s for two.
ALONE, TOGETHER = Limits(expansions=130), Limits(expansions=500)

# Expansions for the first plan of a single player, without and with a clock. With fewer, the search
# often finds no plan, and the beam search that follows takes longer. In plain Python they take at
# most 5 and 0.4 s. With a clock, a player who has no plan gets the larger number, too.
FIRST, FIRST_HURRIED = Limits(expansions=8_000), Limits(expansions=500)

# In real time, a second of planning costs a team more steps than a shorter plan saves
# (docs/planners.md).
HURRIED = Limits(expansions=1)

BRIEF = 500
"""Expansions of the beam search in real time; without a plan, UNSOLVED_FACTOR times as many."""

# Expansions of all searches for one decision in real time. The last search may exceed the limit by
# one layer of the beam. See docs/decisions/0038-bots-with-people.md.
MAX_BRIEF = 8_000

PORTION = 500
"""Expansions after which a bot acts before it searches again, if the game continues."""

PART = 25
"""Expansions for which the analysis of a part of a goal counts. It takes 10 to 20 ms in plain
Python, as long as 50 to 100 expansions. But smaller portions would delay bots with pauses."""

WIDE = 8
"""Factor for the width of the beam if no plan was found otherwise."""

ATTEMPTS = 3
"""Number of plans made for a team that is not in a hurry. The shortest one is used."""

NEAR = 1.11
"""Ratio of a plan's length to the proven bound from which a team looks for another plan."""


@dataclass(frozen=True, slots=True)
class Effort:
    """Limits of planning for a team.

    `choices` is the number of choices of objects to try for the goal. `hurried` is true if the game
    continues during planning.
    """

    choices: int = 1
    hurried: bool = False

    @property
    def brief(self) -> bool:
        """True if all searches for one decision share a limit."""
        # Several choices are tried only next to other participants, who make replanning frequent.
        return self.hurried and self.choices > 1


class PortionSpentError(Exception):
    """The bot has to act before its next search."""


class Portion:
    """Expansions that searches may use before a bot acts.

    A search is never interrupted, because its result must not depend on the portions. So a portion
    ends with the search that exceeds it. The analysis of a part of a goal counts as PART
    expansions.

    Args:
        analysis: False if the analysis of a kitchen does not count.
    """

    def __init__(self, expansions: float = math.inf, *, analysis: bool = True) -> None:
        self._left = expansions
        self.analysis = analysis

    def check(self) -> None:
        """Raise PortionSpentError if no other search may begin."""
        if self._left <= 0:
            raise PortionSpentError

    def spend(self, expansions: int) -> None:
        """Subtract the work of a search or analysis."""
        self._left -= expansions


class TeamSearch:
    """Deterministic searches: equal states and seeds give every bot of a team the same plan.

    Args:
        expansions: Expansions of the beam search for each plan.
    """

    def __init__(self, anytime: AnytimePlanner, seed: int, expansions: int) -> None:
        self._anytime = anytime
        self._seed = seed
        self._expansions = expansions
        self._brief = min(expansions, BRIEF)
        self._one_seat = len(anytime.model.players) == 1

    def best(
        self, state: State, team: tuple[str, ...], effort: Effort, *, after: int = 0
    ) -> SearchResult:
        """Return the shortest of several plans for a team; in a hurry, the first one."""
        best = self.once(state, team, effort, after=after)
        if self._one_seat and effort.hurried and best.plan is None and not best.unsolvable:
            *_, best = self._anytime.search(state, FIRST, seed=self._seed)
            return best
        # One player's plan is improved step by step during play, so one attempt is enough.
        attempts = 1 if len(team) == 1 or effort.hurried else ATTEMPTS
        for number in range(after + 1, after + attempts):
            if best.unsolvable or (best.plan is not None and len(best.plan) <= NEAR * best.bound):
                break
            found = self.once(state, team, effort, after=number)
            best = found if _is_shorter(found, best) else best
        return best

    def once(
        self, state: State, team: tuple[str, ...], effort: Effort, *, after: int = 0
    ) -> SearchResult:
        """Return one plan. Each number `after` gives another one."""
        together = HURRIED if effort.hurried else TOGETHER
        limits = ALONE if len(team) == 1 else together
        if self._one_seat:
            limits = FIRST_HURRIED if effort.hurried else FIRST
        seed = self._seed + after
        *_, found = self._anytime.search(
            state, limits, team=team, seed=seed, beam=self._expansions, choices=effort.choices
        )
        return found

    def brief(
        self,
        state: State,
        team: tuple[str, ...],
        effort: Effort,
        *,
        spent: int,
        after: int = 0,
    ) -> SearchResult:
        """Return a plan found with the expansions that a decision has left."""
        # A failed beam search is repeated with UNSOLVED_FACTOR times as many expansions.
        beam = min(self._brief, (MAX_BRIEF - spent) // UNSOLVED_FACTOR)
        if beam <= 0:
            return SearchResult(None, 0, Proof.NONE, PLANNER, 0)
        return next(
            self._anytime.search(
                state,
                HURRIED,
                team=team,
                seed=self._seed + after,
                beam=beam,
                choices=effort.choices,
                brief=True,
            )
        )

    def analyse(self, state: State, effort: Effort) -> int:
        """Analyse parts of goals for `brief`, at most those of a portion; return their number."""
        return self._anytime.analyse(state, choices=effort.choices, parts=PORTION // PART)

    def wide(self, state: State, team: tuple[str, ...]) -> SearchResult:
        """Return a plan for a state that is hard to leave."""
        beam = WIDE * self._expansions
        *_, found = self._anytime.search(state, HURRIED, team=team, seed=self._seed, beam=beam)
        return found

    def shorter(self, state: State) -> Iterator[SearchResult]:
        """Yield better and better plans for a single player within the limits of a decision."""
        return self._anytime.search(state, ALONE, beam=0)

    def towards(
        self, state: State, team: tuple[str, ...], effort: Effort, *, after: int = 0
    ) -> Plan:
        """Return the plan that came nearest to the goal, if no search reached it."""
        # The arguments equal those of the failed search, so its cached result is used.
        if not effort.brief:
            return self._anytime.towards(state, team=team, seed=self._seed, beam=self._expansions)
        return self._anytime.towards(
            state,
            team=team,
            seed=self._seed + after,
            beam=self._brief,
            choices=effort.choices,
            brief=True,
        )


def _is_shorter(one: SearchResult, other: SearchResult) -> bool:
    if one.plan is None or other.plan is None:
        return one.plan is not None
    return len(one.plan) < len(other.plan)


def station_in_the_way(
    coming: Iterable[GroundAction], state: State, others: Collection[str]
) -> str | None:
    """Return the first destination of some actions at which another player stands."""
    taken = {standing_at(state, player) for player in others}
    return next((each.destination for each in coming if leads_to(each, taken)), None)


def object_in_hand(
    coming: Iterable[GroundAction], state: State, others: Collection[str]
) -> str | None:
    """Return the first object of some actions that another player holds."""
    held = {name for player in others for name in held_by(state, player)}
    return next((name for each in coming for name in each.arguments if name in held), None)


# An appeal makes sense only for an action that the other player could take at once, after walking.
def missing_action(
    script: Script, state: State, others: Iterable[str], rules: Occupancy
) -> GroundAction | None:
    """Return an action that the plan expects of another player and that only places prevent."""
    for player in others:
        planned = None if player in script.astray else script.non_move_action(player)
        if planned is None or not state.world.thing_names.issuperset(planned.arguments):
            continue
        action = state.world.action(planned.name, *planned.arguments)
        unmet = state.world.unmet(state, action)
        if all(u.kind is UnmetKind.BUSY or rules.is_about_standing(u.predicate) for u in unmet):
            return action
    return None


NOT_FOUND = SearchResult(None, 0, Proof.NONE, "", 0)


class Assumption(Enum):
    """Assumption of a plan about the other participants."""

    TEAM = auto()
    """The others stay where they stand."""
    OTHERS_ASIDE = auto()
    """The others step aside."""
    EVERYBODY = auto()
    """The others do their part of the plan."""
    NOTHING = auto()
    """The plan does not reach the goal."""


WAYS = (Assumption.OTHERS_ASIDE, Assumption.EVERYBODY)
"""Assumptions for a team that finds no plan of its own."""


@dataclass(frozen=True, slots=True)
class TeamPlan:
    """A plan, the state for which it was made, and its assumption.

    `found` is the search result if the plan relies on the team alone. `cut_off` is true if others
    block places or hold objects that the team needs. `aside_untried` is true if no search checked
    whether walks of the others would help. `can_begin` is false if the team can do nothing until
    the others step aside. `instead_of` is the plan for a more urgent goal, which others prevent.
    """

    plan: Plan
    base: State
    assumption: Assumption
    found: SearchResult = NOT_FOUND
    cut_off: bool = False
    aside_untried: bool = False
    can_begin: bool = True
    instead_of: TeamPlan | None = None


class TeamPlanner:
    """Planner for the team of a seat. Equal states give equal plans to the whole team.

    Args:
        alone: True to ignore other participants.
    """

    def __init__(self, anytime: AnytimePlanner, search: TeamSearch, *, alone: bool) -> None:
        self._anytime = anytime
        self._search = search
        self._alone = alone
        self._players = tuple(sorted(anytime.model.players))

    def decide(
        self,
        base: State,
        team: Collection[str],
        *,
        hurried: bool,
        tried: int = 0,
        working: Collection[str] = (),
        rest: TeamPlan | None = None,
        unused: Collection[str] = (),
    ) -> TeamDecision:
        """Return the decision about a plan from a state.

        Args:
            hurried: True if the game continues during planning.
            tried: Number of earlier plans from this state that failed.
            working: Other participants who have done something lately.
            rest: A plan of the team from this state, which only a better plan may replace.
            unused: Members of the team who need work that they can begin at once.
        """
        return TeamDecision(
            self._anytime,
            self._search,
            base,
            tuple(sorted(team)),
            self.effort(team, hurried=hurried),
            tried=tried,
            alone=self._alone,
            # Someone who works and holds an object probably means to use it.
            expects_help=any(holds(base, player) for player in working),
            rest=rest,
            unused=unused,
        )

    def effort(self, team: Collection[str], *, hurried: bool = False) -> Effort:
        """Return the limits of planning for a team."""
        all_ours = self._alone or len(team) == len(self._players)
        return Effort(choices=1 if all_ours else CHOICES, hurried=hurried)


class TeamDecision:
    """A choice between the possible plans of a team, from one state."""

    def __init__(
        self,
        anytime: AnytimePlanner,
        search: TeamSearch,
        base: State,
        team: tuple[str, ...],
        effort: Effort,
        *,
        tried: int,
        alone: bool,
        expects_help: bool,
        rest: TeamPlan | None,
        unused: Collection[str],
    ) -> None:
        self._anytime = anytime
        self._search = search
        self._base = base
        self._team = team
        self._players = tuple(sorted(anytime.model.players))
        self._alone = alone
        self._effort = effort
        self._tried = tried
        # Another attempt from the same state must not repeat the same search.
        self._number = ATTEMPTS * tried
        self._found: dict[tuple[State, tuple[str, ...], int], SearchResult] = {}
        self._portion = Portion()
        self._cut_off = not alone and anytime.is_cut_off(base, team)
        self._spent = 0
        self._aside_untried = True
        self._expects_help = expects_help
        self._rest = rest
        self._unused = frozenset(unused)

    def plan(self, portion: Portion) -> TeamPlan:
        """Return a plan of the team's own, or a replacement.

        Raises:
            PortionSpentError: The portion is spent. The next call continues with the next search.
        """
        # Each call begins again, with the results of all earlier searches. So the plan does not
        # depend on the portions.
        self._portion, self._spent, self._aside_untried = portion, 0, True
        return self._plan()

    def _plan(self) -> TeamPlan:
        if self._rest is not None:
            return self._better_than(self._rest)
        found = NOT_FOUND
        # The reachability test is cheap; a search would spend all its expansions without finding a
        # plan.
        if not self._cut_off:
            unburdened = self._unburdened(self._team) if self._tried % 2 else None
            if unburdened is not None:
                return TeamPlan(unburdened, self._base, Assumption.TEAM, found)
            found = self._find(self._base, self._team)
        if found.plan is not None:
            return TeamPlan(found.plan, self._base, Assumption.TEAM, found)
        if found.unsolvable:
            return TeamPlan(Plan(()), self._base, Assumption.NOTHING, found, can_begin=False)
        return self._with_fewer() or self._way() or self._nearer()

    def _better_than(self, rest: TeamPlan) -> TeamPlan:
        """Return the rest of the last plan, or a better plan.

        A plan is better if it relies on the team alone, or if an unused member can begin. If the
        last plan relies on the team alone, shorter plans are better.
        """
        if rest.assumption is Assumption.TEAM:
            return self._shorter_than(rest.plan)
        if not self._cut_off:
            found = self._find(self._base, self._team)
            if found.plan is not None:
                return TeamPlan(found.plan, self._base, Assumption.TEAM, found)
        return self._with_others_aside(only_useful=True) or rest

    def _shorter_than(self, rest: Plan) -> TeamPlan:
        """Return the best of the rest of the last plan and some other plans.

        A step for which a member waits before its first action counts like a step of the plan: to
        people, a bot that stands still is of no use, whatever it waits for.
        """
        plans = [rest]
        for number in range(1, ATTEMPTS + 1):
            found = self._find(self._base, self._team, number).plan
            if found is not None:
                plans.append(found)
        # A member with an object in hand may wait for a station, though it has other work.
        plans += filter(None, (self._unburdened((player,)) for player in self._team))
        best = min(plans, key=lambda plan: len(plan) + self._idle_steps(plan))
        return TeamPlan(best, self._base, Assumption.TEAM)

    def _idle_steps(self, plan: Plan) -> int:
        """Return the number of steps for which members wait for their first actions, in all."""
        first = {
            action.player: step for step, joint in reversed([*enumerate(plan)]) for action in joint
        }
        return sum(first.get(player, len(plan)) for player in self._team)

    def _unburdened(self, players: Iterable[str]) -> Plan | None:
        """Return a plan in which some players first put down all that they hold, or None.

        A search may miss it because objects in hand bring most states nearer to the goal.
        """
        steps, start = self._emptied(self._anytime.in_model(self._base), players)
        plan = self._find(start, self._team).plan if steps else None
        return None if plan is None else Plan((*steps, *plan))

    def _emptied(
        self, state: State, players: Iterable[str]
    ) -> tuple[list[tuple[GroundAction, ...]], State]:
        """Return steps in which players put down all that they hold, and the state after them."""
        steps: list[tuple[GroundAction, ...]] = []
        for player in players:
            for action in put_down(state, player):
                steps.append((action,))
                state = after(state, action)
        return steps, state

    def _with_fewer(self) -> TeamPlan | None:
        """Return a plan in which one of the team does nothing, or None.

        A search for many players looks at many joint actions, so it may find no plan where one for
        fewer players does.
        """
        if len(self._team) == 1 or self._effort.brief or self._cut_off:
            return None
        for player in self._team:
            found = self._find(self._base, tuple(p for p in self._team if p != player))
            if found.plan is not None:
                return TeamPlan(found.plan, self._base, Assumption.TEAM, found)
        return None

    def _way(self) -> TeamPlan | None:
        """Return a plan that assumes that others step aside or help, or None."""
        ways = [self._with_others_aside, self._with_everybody]
        if self._expects_help:
            ways.reverse()
        # After a failed plan the other assumption comes first, so that no team repeats the same
        # mistake. Later attempts keep the first one and search differently.
        if self._tried % len(ways) and self._tried <= len(ways):
            ways.reverse()
        return ways[0]() or ways[1]()

    def _with_everybody(self) -> TeamPlan | None:
        """Return a plan in which everybody plays a part, or None."""
        if self._team == self._players:
            return None
        plan = self._find(self._base, self._players).plan
        if plan is None:
            return None
        return TeamPlan(
            plan,
            self._base,
            Assumption.EVERYBODY,
            cut_off=self._cut_off,
            aside_untried=self._aside_untried,
        )

    def _nearer(self) -> TeamPlan:
        """Return a plan of a wider search if there is time, else one that leads nearer the goal."""
        base, team = self._base, self._team
        # The wide search takes long. Repeating it from the same state would fail again.
        if not (self._alone or self._effort.hurried or self._tried):
            found = self._search.wide(base, team)
            if found.plan is not None:
                return TeamPlan(found.plan, base, Assumption.TEAM, found)
        plan = (
            self._possible_part()
            if self._cut_off
            else self._search.towards(base, team, self._effort, after=self._number)
        )
        return TeamPlan(
            plan, base, Assumption.NOTHING, cut_off=self._cut_off, can_begin=bool(len(plan))
        )

    def _possible_part(self) -> Plan:
        """Return the steps possible now of the plan nearest to the goal if others stepped aside."""
        here = self._anytime.in_model(self._base)
        start = with_others_aside(here, [p for p in self._players if p not in self._team])
        if (start, self._team, 0) not in self._found:
            return Plan(())  # Another search would take too long.
        plan = self._search.towards(start, self._team, self._effort, after=self._number)
        return possible_part(plan, start, here, self._team)

    def _with_others_aside(self, *, only_useful: bool = False) -> TeamPlan | None:
        """Return a plan that assumes that the others step aside, or None.

        Args:
            only_useful: True to return only a plan in which an unused member can begin.
        """
        self._aside_untried = False
        here = self._anytime.in_model(self._base)
        start = with_others_aside(here, [p for p in self._players if p not in self._team])
        if start == here or self._anytime.is_cut_off(start, self._team):
            return None
        found: TeamPlan | None = None
        for plan, beginners in self._plans_aside(start, here):
            made = TeamPlan(
                plan,
                start,
                Assumption.OTHERS_ASIDE,
                cut_off=self._cut_off,
                can_begin=bool(beginners),
            )
            # Members without work come first, so that they do not wait next to busy ones.
            if beginners and (not self._unused or beginners & self._unused):
                return made
            if found is None or (beginners and not found.can_begin):
                found = made
        return None if only_useful else found

    def _plans_aside(self, start: State, here: State) -> Iterator[tuple[Plan, set[str]]]:
        """Yield plans for others who step aside, and the members that can begin before they do.

        In the last plans, the players first put down what keeps them from other work.
        """
        teams = [self._team]
        if self._effort.brief and len(self._team) > 1:
            # A search for one player has far fewer choices.
            turn = self._tried % len(self._team)
            order = self._team[turn:] + self._team[:turn]
            teams += [(player,) for player in sorted(order, key=lambda p: p not in self._unused)]
        yield from self._deferred(start, here, teams)
        steps, start = self._emptied(start, self._team)
        for (action,) in steps:
            if not here.world.applicable(here, action):
                return
            here = after(here, action)
        if steps:
            for plan, begins in self._deferred(start, here, teams[::-1]):
                yield Plan((*steps, *plan)), begins

    def _deferred(
        self, start: State, here: State, teams: Iterable[tuple[str, ...]]
    ) -> Iterator[tuple[Plan, set[str]]]:
        """Yield plans from a state with all work first that is possible in another one."""
        for team in teams:
            plan = self._find(start, team).plan
            if plan is not None:
                plan = defer_blocked(plan, start, here, self._team)
                yield plan, who_can_begin(plan, start, here, self._team)
            elif len(team) == 1:
                return  # A failed search takes UNSOLVED_FACTOR times as long.

    def _find(self, state: State, team: tuple[str, ...], number: int = 0) -> SearchResult:
        """Return a search result for some players, within the limit of the decision.

        Each `number` gives another plan.
        """
        after = self._number + number
        if not self._effort.brief:
            return self._search.best(state, team, self._effort, after=after)
        found = self._found.get((state, team, number))
        if found is None:
            self._analyse(state)
            found = self._search.brief(state, team, self._effort, spent=self._spent, after=after)
            self._portion.spend(found.expansions)
            self._found[state, team, number] = found
        self._spent += found.expansions
        return found

    def _analyse(self, state: State) -> None:
        """Analyse what a search from a state needs, within the portion."""
        complete = False
        while not complete:
            self._portion.check()
            if not self._portion.analysis:
                return
            new = self._search.analyse(state, self._effort)
            self._portion.spend(PART * new)
            complete = new < PORTION // PART
