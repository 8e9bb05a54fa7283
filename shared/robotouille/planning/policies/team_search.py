"""Plans for some of the seats, as good as they can be had in the time that a game leaves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.beam.planner import PLANNER, UNSOLVED_FACTOR
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import Limits, Proof, SearchResult
from robotouille.world.world import State

__all__ = ["EXPANSIONS", "MAX_BRIEF", "NEAR", "Effort", "TeamSearch"]

EXPANSIONS = 2_000
"""Of the beam search, for each plan of a team."""

ALONE, TOGETHER = Limits(expansions=130), Limits(expansions=500)
"""What may be spent on a decision, or on a plan for two, to find a shorter plan: about 0.1 s for
one player and 0.5 s for two in plain Python."""

HURRIED = Limits(expansions=1)
"""The same where the world moves on meanwhile: a second of thought costs a team more steps than a
shorter plan wins back (docs/planners.md)."""

STUBBORN = Limits(expansions=2_000)
"""What is spent on any plan at all, where a player who is alone has found none: seconds."""

BRIEF = 1_500
"""Of the beam search where people play on meanwhile; where it finds no plan,
`UNSOLVED_FACTOR` times as many."""

MAX_BRIEF = 8_000
"""Of it for all plans that are sought for one decision there, whatever they find; the last one may
take a layer of the beam more. One or two seconds, seldom more than a fifth of that; two more in a
domain without a plug-in, where a greedy search follows each that is in vain."""

WIDE = 8
"""How much wider the beam is for a plan that was not found otherwise."""

ATTEMPTS = 3
"""Plans that are made for a team where nobody is in a hurry; the shortest is followed."""

NEAR = 1.11
"""By how much a plan may be longer than what is proven before a team makes another."""


@dataclass(frozen=True, slots=True)
class Effort:
    """What a plan for a team may take: `choices` of objects for the goal are tried; `hurried` says
    that the game goes on meanwhile."""

    choices: int = 1
    hurried: bool = False

    @property
    def brief(self) -> bool:
        """Whether all that is sought for one decision has a bound."""
        return self.hurried and self.choices > 1


class TeamSearch:
    """Searches for a team: from the same state, with the same seed, all of it find the same plan.

    Args:
        expansions: Of the beam search, for each plan.
    """

    def __init__(self, anytime: AnytimePlanner, seed: int, expansions: int) -> None:
        self._anytime = anytime
        self._seed = seed
        self._expansions = expansions
        self._brief = min(expansions, BRIEF)
        self._one_seat = len(anytime.model.players) == 1

    def best(self, state: State, team: tuple[str, ...], effort: Effort) -> SearchResult:
        """The best of some plans for a team; the first one, where its players are in a hurry."""
        best = self.once(state, team, effort)
        if self._one_seat and best.plan is None and not best.unsolvable:
            return self._anytime.first(state, STUBBORN, seed=self._seed)
        attempts = 1 if len(team) == 1 or effort.hurried else ATTEMPTS
        for number in range(1, attempts):
            if best.unsolvable or (best.plan is not None and len(best.plan) <= NEAR * best.bound):
                break
            found = self.once(state, team, effort, after=number)
            best = found if _is_shorter(found, best) else best
        return best

    def once(
        self, state: State, team: tuple[str, ...], effort: Effort, *, after: int = 0
    ) -> SearchResult:
        """One plan; another with each number `after`."""
        together = HURRIED if effort.hurried else TOGETHER
        limits = ALONE if len(team) == 1 else together
        seed = self._seed + after
        *_, found = self._anytime.search(
            state, limits, team=team, seed=seed, beam=self._expansions, choices=effort.choices
        )
        return found

    def brief(
        self, state: State, team: tuple[str, ...], effort: Effort, *, spent: int
    ) -> SearchResult:
        """The first plan that is found with little work, of what a decision has left."""
        beam = min(self._brief, (MAX_BRIEF - spent) // UNSOLVED_FACTOR)
        if beam <= 0:
            return SearchResult(None, 0, Proof.NONE, PLANNER, 0)
        return next(
            self._anytime.search(
                state,
                HURRIED,
                team=team,
                seed=self._seed,
                beam=beam,
                choices=effort.choices,
                brief=True,
            )
        )

    def wide(self, state: State, team: tuple[str, ...]) -> SearchResult:
        """A plan for a state that is hard to get out of."""
        beam = WIDE * self._expansions
        *_, found = self._anytime.search(state, HURRIED, team=team, seed=self._seed, beam=beam)
        return found

    def shorter(self, state: State) -> Iterator[SearchResult]:
        """Better and better plans for one who is alone, as far as a decision leaves time."""
        return self._anytime.search(state, ALONE, beam=0)

    def towards(self, state: State, team: tuple[str, ...], effort: Effort) -> Plan:
        """As near to the goal as the team gets without a plan: as far as `brief` or `best` got."""
        if not effort.brief:
            return self._anytime.towards(state, team=team, seed=self._seed, beam=self._expansions)
        return self._anytime.towards(
            state, team=team, seed=self._seed, beam=self._brief, choices=effort.choices, brief=True
        )


def _is_shorter(one: SearchResult, other: SearchResult) -> bool:
    if one.plan is None or other.plan is None:
        return one.plan is not None
    return len(one.plan) < len(other.plan)
