"""How a team comes by a plan: one of its own, one for when others have made way, or have done their
part, or what leads as near to the goal as it gets.

Where people play on meanwhile, all of it together has a bound in expansions (`MAX_BRIEF`), and so
takes a second or two at worst.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum, auto

from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.plan import Plan
from robotouille.planning.policies.deferral import defer_blocked
from robotouille.planning.policies.making_way import with_others_aside
from robotouille.planning.policies.team_search import Effort, TeamSearch
from robotouille.planning.search_result import Proof, SearchResult
from robotouille.world.world import State

__all__ = ["WAYS", "Reliance", "TeamPlan", "TeamPlanner"]

CHOICES = 6
"""Choices of objects that are tried where others may stand in the way of the first."""

NOT_FOUND = SearchResult(None, 0, Proof.NONE, "", 0)


class Reliance(Enum):
    """On what a plan counts."""

    TEAM = auto()
    """The team alone: all others may stand where they stand."""
    OTHERS_ASIDE = auto()
    """That others walk to where they are in nobody's way."""
    EVERYBODY = auto()
    """That others do their part of it."""
    NOTHING = auto()
    """It does not reach the goal."""


WAYS = (Reliance.OTHERS_ASIDE, Reliance.EVERYBODY)
"""On what a team counts that finds no plan of its own."""


@dataclass(frozen=True, slots=True)
class TeamPlan:
    """A plan, the state for which it was made, and what it counts on.

    `found` is what is known of it where it counts on the team alone. `cut_off` says that others
    stand where the team has to get, or have what it needs; `aside_untried` that it is not known
    whether it would help if they walked.
    """

    plan: Plan
    base: State
    relies_on: Reliance
    found: SearchResult = NOT_FOUND
    cut_off: bool = False
    aside_untried: bool = False


class TeamPlanner:
    """Makes plans for the team of a seat. From the same state they are the same for all of it.

    Args:
        alone: There is nobody to be reckoned with.
    """

    def __init__(self, anytime: AnytimePlanner, search: TeamSearch, *, alone: bool) -> None:
        self._anytime = anytime
        self._search = search
        self._alone = alone
        self._players = tuple(sorted(anytime.model.players))

    def make(
        self, base: State, team: Collection[str], *, hurried: bool, tried: int = 0
    ) -> TeamPlan:
        """A plan from a state.

        Args:
            hurried: The game goes on meanwhile.
            tried: How often plans from there have come to nothing: where the team finds none of its
                own, it counts on others in another way each time.
        """
        seats, effort = tuple(sorted(team)), self.effort(team, hurried=hurried)
        decision = _Decision(
            self._anytime, self._search, base, seats, effort, tried=tried, alone=self._alone
        )
        return decision.plan()

    def effort(self, team: Collection[str], *, hurried: bool = False) -> Effort:
        """What a plan for a team may take; others may stand in the way of the first choice."""
        all_ours = self._alone or len(team) == len(self._players)
        return Effort(choices=1 if all_ours else CHOICES, hurried=hurried)


class _Decision:
    """One call for a plan: for whom, what it may cost, and what it has cost so far."""

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
    ) -> None:
        self._anytime = anytime
        self._search = search
        self._base = base
        self._team = team
        self._players = tuple(sorted(anytime.model.players))
        self._alone = alone
        self._effort = effort
        self._tried = tried
        self._cut_off = not alone and anytime.is_cut_off(base, team)
        self._spent = 0

    def plan(self) -> TeamPlan:
        """The plan of the team's own, or else what there is instead."""
        found = NOT_FOUND if self._cut_off else self._find(self._base, self._team)
        if found.plan is not None:
            return TeamPlan(found.plan, self._base, Reliance.TEAM, found)
        if found.unsolvable:
            return TeamPlan(Plan(()), self._base, Reliance.NOTHING, found)
        return self._way() or self._nearer()

    def _way(self) -> TeamPlan | None:
        """A plan as if others made way or did their part; the other one first where that was in
        vain."""
        base, tried, cut_off = self._base, self._tried, self._cut_off
        for number in range(tried, tried + len(WAYS)):
            if WAYS[number % len(WAYS)] is Reliance.OTHERS_ASIDE:
                start = self._others_aside()
                found = NOT_FOUND if start is None else self._find(start, self._team)
                if start is not None and found.plan is not None:
                    here = self._anytime.in_model(base)
                    plan = defer_blocked(found.plan, start, here, self._team)
                    return TeamPlan(plan, start, Reliance.OTHERS_ASIDE, cut_off=cut_off)
            elif self._team != self._players:
                found = self._find(base, self._players)
                if found.plan is not None:
                    untried = number == tried and number % len(WAYS) > 0
                    return TeamPlan(
                        found.plan,
                        base,
                        Reliance.EVERYBODY,
                        cut_off=cut_off,
                        aside_untried=untried,
                    )
        return None

    def _nearer(self) -> TeamPlan:
        """A plan by a wider search, where there is time; without any, what leads nearer."""
        base, team = self._base, self._team
        if not (self._alone or self._effort.hurried or self._tried):
            found = self._search.wide(base, team)
            if found.plan is not None:
                return TeamPlan(found.plan, base, Reliance.TEAM, found)
        plan = Plan(())
        if not self._cut_off:
            plan = self._search.towards(base, team, self._effort)
        return TeamPlan(plan, base, Reliance.NOTHING, cut_off=self._cut_off)

    def _others_aside(self) -> State | None:
        """The state in which others have made way; None if that does not help."""
        here = self._anytime.in_model(self._base)
        aside = with_others_aside(here, [p for p in self._players if p not in self._team])
        return None if aside == here or self._anytime.is_cut_off(aside, self._team) else aside

    def _find(self, state: State, team: tuple[str, ...]) -> SearchResult:
        """A plan for some players; where people play on meanwhile, with little work."""
        if not self._effort.brief:
            return self._search.best(state, team, self._effort)
        found = self._search.brief(state, team, self._effort, spent=self._spent)
        self._spent += found.expansions
        return found
