"""Whether a plan is still good to follow: what each step that passes says about it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

from robotouille.planning.policies.making_way import station_in_the_way
from robotouille.planning.policies.past_step import PastStep
from robotouille.planning.policies.script import Script
from robotouille.planning.policies.standing import leads_to, standing_at
from robotouille.planning.policies.team_plan import WAYS, Reliance, TeamPlan
from robotouille.world.world import State

__all__ = ["DROP", "KEEP", "Company", "PlanBase", "PlanWatch", "Verdict", "facts_about"]

PATIENCE = 2
"""Steps for each seat in which nothing goes on, before a team plans anew."""

SLOW = 10
"""How much more of them a team waits in real time for one of it that thinks."""


class Company(NamedTuple):
    """Who plays: the team, and the others in seat order; whether one of those may be a bot.
    `hurried` says that the game goes on while somebody thinks."""

    team: Collection[str]
    others: Sequence[str]
    among_bots: bool = False
    hurried: bool = False


class PlanBase(NamedTuple):
    """From where a plan was found to be needed: the step, the state after it, and the facts about
    players who were not of the team."""

    step: int
    state: State
    others: int


class Verdict(NamedTuple):
    """What becomes of a plan: whether it is kept; who is not to be counted on any more, the seat
    itself among them if it has strayed; whether the way that it counted on has become free."""

    keeps: bool = True
    without: frozenset[str] = frozenset()
    way_is_free: bool = False


KEEP, DROP = Verdict(), Verdict(keeps=False)


class PlanWatch:
    """Watches one plan of a team while a seat follows it.

    Args:
        retry: Steps after which a plan may be sought again where the team has none of its own.
        in_vain: How often plans from a state came to nothing.
        is_cut_off: Whether a team cannot reach the goal while all others stand still.
    """

    def __init__(
        self,
        made: TeamPlan,
        script: Script,
        base: PlanBase,
        *,
        retry: int,
        in_vain: Mapping[State, int],
        is_cut_off: Callable[[State, Collection[str]], bool],
    ) -> None:
        self.script = script
        self.relies_on = made.relies_on
        self._made = made
        self._base = base
        self._retry = retry
        self._in_vain = in_vain
        self._is_cut_off = is_cut_off
        self._patience = PATIENCE * len(base.state.world.players)
        self._meddled = False
        self._stuck = self._blocked = 0

    @property
    def is_stuck(self) -> bool:
        """Whether nothing has gone on for too long."""
        return self._stuck > self._patience

    def heed(self, past: PastStep, company: Company) -> Verdict:
        """Take in a step that has passed; called once for each after the base, in order."""
        team, others = company.team, company.others
        self._meddled = self._meddled or past.is_meddling(team)
        self.script.observe(past.did, past.state.world.players if others else ())
        astray = self.script.astray & set(team)
        if astray:
            return Verdict(keeps=False, without=frozenset(astray))
        if self.relies_on is Reliance.TEAM:
            return self._heed_delay(past, company)
        return self._heed_standstill(past, company)

    def _heed_delay(self, past: PastStep, company: Company) -> Verdict:
        """Others may be in the way, or somebody of the team may do nothing."""
        script, state, team = self.script, past.state, company.team
        if state.goal_reached:
            return KEEP
        due = {p: script.due(p, state) for p in team if not state.busy_steps(p)}
        blocked = {p for p, a in due.items() if a and not state.world.applicable(state, a)}
        taken = {standing_at(state, player) for player in company.others}
        in_the_way = any(a and leads_to(a, taken) for a in due.values())
        held_up = in_the_way or (blocked and not past.is_running(team))
        self._blocked = self._blocked + 1 if held_up else 0
        self._count_standstill(past, team)
        if (blocked and past.is_meddling(team)) or self._blocked > self._patience:
            return DROP
        if not self.is_stuck:
            return KEEP
        late = {p for p, a in due.items() if a and p not in blocked} - {script.player}
        if not late:
            return DROP
        if company.hurried and self._stuck <= SLOW * self._patience:
            return KEEP
        return Verdict(keeps=False, without=frozenset(late))

    def _heed_standstill(self, past: PastStep, company: Company) -> Verdict:
        """Without a plan of the team's own: others may have opened a way, or bots may wait for each
        other."""
        state = past.state
        self._count_standstill(past, company.team)
        untried = company.among_bots and self._in_vain.get(state, 0) < len(WAYS)
        due = past.step - self._base.step >= self._retry
        if (due and self._may_see_a_way(state, company)) or (untried and self.is_stuck):
            return DROP
        if self.relies_on is not Reliance.OTHERS_ASIDE or self._meddled:
            return KEEP
        if self._station_in_the_way(state, company) is not None:
            return KEEP
        self.relies_on = Reliance.TEAM  # The plan is good as it is.
        return Verdict(way_is_free=True)

    def _count_standstill(self, past: PastStep, team: Collection[str]) -> None:
        goes_on = past.has_acted(team) or past.is_running(team)
        self._stuck = 0 if goes_on else self._stuck + 1

    def _may_see_a_way(self, state: State, company: Company) -> bool:
        """Whether what has changed may have opened a way, or closed the one that was hoped for."""
        if self.relies_on is Reliance.EVERYBODY:  # Who does their part does what is hoped for.
            meddled = not self.script.astray <= set(company.team)
        else:
            meddled = self._meddled
        walked = self._walked_elsewhere(state, company)
        done = self.script.is_finished(company.team) and state != self._base.state
        return meddled or walked or (done and not self._made.cut_off)

    def _walked_elsewhere(self, state: State, company: Company) -> bool:
        """Whether others have walked from where they were in the way to where they are, as well; or
        where it is not known that they are, to where they are not."""
        if self.relies_on is Reliance.OTHERS_ASIDE:
            before = {standing_at(self._base.state, player) for player in company.others}
            return self._station_in_the_way(state, company) not in {None, *before}
        if facts_about(company.others, state) == self._base.others:
            return False
        opened = self._made.cut_off and not self._is_cut_off(state, company.team)
        return opened or self._made.aside_untried

    def _station_in_the_way(self, state: State, company: Company) -> str | None:
        return station_in_the_way(self.script.rest(company.team), state, company.others)


def facts_about(players: Collection[str], state: State) -> int:
    """The facts of a state about some players."""
    facts = 0
    for player in players:
        facts |= state.facts & state.world.table.mentions(player)
    return facts
