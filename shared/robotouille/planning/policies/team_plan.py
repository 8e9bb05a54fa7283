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
from robotouille.planning.policies.team_search import TeamSearch
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
        self._hurried = self._brief = False
        self._choices = 1
        self._spent = 0

    def make(
        self, base: State, team: Collection[str], *, hurried: bool, tried: int = 0
    ) -> TeamPlan:
        """A plan from a state.

        Args:
            hurried: The game goes on meanwhile.
            tried: How often plans from there have come to nothing: where the team finds none of its
                own, it counts on others in another way each time.
        """
        self._hurried, self._spent = hurried, 0
        seats = tuple(sorted(team))
        self._choices = self.choices(seats)
        self._brief = hurried and self._choices > 1
        cut_off = not self._alone and self._anytime.is_cut_off(base, seats)
        found = NOT_FOUND if cut_off else self._find(base, seats)
        if found.plan is not None:
            return TeamPlan(found.plan, base, Reliance.TEAM, found)
        if found.unsolvable:
            return TeamPlan(Plan(()), base, Reliance.NOTHING, found)
        way = self._way(base, seats, tried, cut_off=cut_off)
        return way or self._nearer(base, seats, tried, cut_off=cut_off)

    def choices(self, team: Collection[str]) -> int:
        """How many choices of objects are tried: others may stand in the way of the first."""
        return 1 if self._alone or len(team) == len(self._players) else CHOICES

    def _way(
        self, base: State, team: tuple[str, ...], tried: int, *, cut_off: bool
    ) -> TeamPlan | None:
        """A plan as if others made way or did their part; the other one first where that was in
        vain."""
        for number in range(tried, tried + len(WAYS)):
            if WAYS[number % len(WAYS)] is Reliance.OTHERS_ASIDE:
                start = self._others_aside(base, team)
                found = NOT_FOUND if start is None else self._find(start, team)
                if start is not None and found.plan is not None:
                    here = self._anytime.in_model(base)
                    plan = defer_blocked(found.plan, start, here, team)
                    return TeamPlan(plan, start, Reliance.OTHERS_ASIDE, cut_off=cut_off)
            elif team != self._players:
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

    def _nearer(self, base: State, team: tuple[str, ...], tried: int, *, cut_off: bool) -> TeamPlan:
        """A plan by a wider search, where there is time; without any, what leads nearer."""
        if not (self._alone or self._hurried or tried):
            found = self._search.wide(base, team)
            if found.plan is not None:
                return TeamPlan(found.plan, base, Reliance.TEAM, found)
        plan = Plan(())
        if not cut_off:
            plan = self._search.towards(base, team, choices=self._choices, brief=self._brief)
        return TeamPlan(plan, base, Reliance.NOTHING, cut_off=cut_off)

    def _others_aside(self, base: State, team: tuple[str, ...]) -> State | None:
        """The state in which others have made way; None if that does not help."""
        here = self._anytime.in_model(base)
        aside = with_others_aside(here, [p for p in self._players if p not in team])
        return None if aside == here or self._anytime.is_cut_off(aside, team) else aside

    def _find(self, state: State, team: tuple[str, ...]) -> SearchResult:
        """A plan for some players; where people play on meanwhile, with little work."""
        if not self._brief:
            return self._search.best(state, team, in_a_hurry=self._hurried, choices=self._choices)
        found = self._search.brief(state, team, choices=self._choices, spent=self._spent)
        self._spent += found.expansions
        return found
