"""Checks after each step whether a plan is still good to follow."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

from robotouille.planning.policies.aside import with_others_aside
from robotouille.planning.policies.policy import Did, Script, does_something
from robotouille.planning.policies.standing import leads_to, standing_at
from robotouille.planning.policies.team_plan import (
    WAYS,
    Assumption,
    TeamPlan,
    object_in_hand,
    station_in_the_way,
)
from robotouille.world.scene import scene
from robotouille.world.timers import Timers
from robotouille.world.world import State


class PastStep(NamedTuple):
    """A past step: its number, the state after it, and its actions."""

    step: int
    state: State
    did: Did

    def has_acted(self, team: Collection[str]) -> bool:
        """Return whether a player of the team has done something."""
        return any(p in team and ok and does_something(action) for p, action, ok in self.did)

    def is_meddling(self, team: Collection[str]) -> bool:
        """Return whether other players have done something other than walk."""
        return any(
            p not in team and ok and action.destination is None
            for p, action, ok in self.did
            if does_something(action)
        )

    def is_running(self, team: Collection[str]) -> bool:
        """Return whether time alone will change something, such as a delay."""
        if any(player in team for player, _ in self.state.timers.busy):
            return True
        return any(row.timed and row.running for row in self.state.progress())


PATIENCE = 2
"""Steps per seat without progress before a team plans again."""

# In real time a team waits this many times longer for a member, whose planning takes steps too.
SLOW = 10


UNUSED = 25
"""Steps without an action of a member after which a team looks for a shorter plan in real time."""

LONG = 15
"""Steps without progress after which a team that waits for a person plans again: three seconds at
five steps a second."""


Situation = tuple[int, Timers]


def situation(state: State) -> Situation:
    """Return what players can change. States of a shift also contain the time."""
    return state.facts, state.timers


class Teammates(NamedTuple):
    """The players of the team, and the others in seat order.

    `among_bots` is true if one of the others may be a bot. `hurried` is true if the game continues
    while players think.
    """

    team: Collection[str]
    others: Sequence[str]
    among_bots: bool = False
    hurried: bool = False


class PlanBase(NamedTuple):
    """Point from which a plan is needed: step, state, and facts about players outside the team.

    `idle` is the number of steps in a row for which each member has done nothing, also under
    earlier plans.
    """

    step: int
    state: State
    others: int
    idle: Mapping[str, int] = MappingProxyType({})


def unused_members(idle: Mapping[str, int]) -> frozenset[str]:
    """Return the members who have done nothing for long next to others of the team who work.

    Args:
        idle: The number of steps in a row for which each member has done nothing.
    """
    unused = frozenset(player for player, steps in idle.items() if steps >= UNUSED)
    return unused if len(unused) < len(idle) else frozenset()


class PlanVerdict(NamedTuple):
    """The result of a check.

    `keep` is false if the plan has to be replaced. The team no longer counts on the players in
    `without`; the seat itself is one of them if it has deviated. `way_is_free` is true if the
    others have stepped aside as the plan assumed. `unused` is true if the plan is good, but leaves
    a member without work for long.
    """

    keep: bool = True
    without: frozenset[str] = frozenset()
    way_is_free: bool = False
    unused: bool = False


KEEP, DROP = PlanVerdict(), PlanVerdict(keep=False)


def _is_in_the_way(made: TeamPlan, state: State, teammates: Teammates) -> bool:
    """Return whether others block or hold what a plan needs, if it relies on making way."""
    if made.assumption is not Assumption.OTHERS_ASIDE:
        return False
    coming = [each for joint in made.plan for each in joint if each.player in teammates.team]
    others = teammates.others
    return bool(station_in_the_way(coming, state, others) or object_in_hand(coming, state, others))


class PlanWatch:
    """Monitor of one plan of a team while a seat follows it.

    Args:
        retry: Steps after which the team may search again if it has no plan of its own.
        in_vain: Number of failed plans by situation.
        is_cut_off: Function that returns whether a team cannot reach the goal while all others
            stand still.
    """

    def __init__(
        self,
        made: TeamPlan,
        script: Script,
        base: PlanBase,
        *,
        retry: int,
        in_vain: Mapping[Situation, int],
        is_cut_off: Callable[[State, Collection[str]], bool],
    ) -> None:
        self.script = script
        self.assumption = made.assumption
        self._made = made
        self.base = base
        self._retry = retry
        self._in_vain = in_vain
        self._is_cut_off = is_cut_off
        # Players who act in turn make progress only once per round.
        self._patience = PATIENCE * len(base.state.world.players)
        self._meddled = False
        self._stuck = self._blocked = 0
        self.idle = dict(base.idle)

    @property
    def is_stuck(self) -> bool:
        """True if there was no progress for too long."""
        return self._stuck > self._patience

    def rest(self, here: State, others: Collection[str]) -> TeamPlan | None:
        """Return the rest of the plan from a state of the planner's model.

        Return None if the rest does not reach the goal.
        """
        aside = self.assumption is Assumption.OTHERS_ASIDE
        start = with_others_aside(here, others) if aside else here
        plan = self.script.shortened(start)
        if plan is None:
            return None
        return replace(self._made, plan=plan, base=start, assumption=self.assumption)

    def check(self, past: PastStep, teammates: Teammates) -> PlanVerdict:
        """Process a past step. Called once for each step after the base, in order."""
        team, others = teammates.team, teammates.others
        self._meddled = self._meddled or past.is_meddling(team)
        acted = {p for p, action, ok in past.did if ok and does_something(action)}
        # Players who have left the team no longer count.
        self.idle = {
            player: 0
            if player in acted or past.state.busy_steps(player)
            else self.idle.get(player, 0) + 1
            for player in team
        }
        # In real time, bots walk for reasons that are in no plan.
        anywhere = others or teammates.hurried
        self.script.observe(past.did, past.state.world.players if anywhere else ())
        # A member that deviates has another plan, or none. The others stop counting on it.
        astray = self.script.astray & set(team)
        if astray:
            return PlanVerdict(keep=False, without=frozenset(astray))
        if self._may_return(past, teammates):
            return DROP
        if self.assumption is Assumption.TEAM:
            return self._check_delay(past, teammates)
        return self._check_standstill(past, teammates)

    def _may_return(self, past: PastStep, teammates: Teammates) -> bool:
        """Return whether others may no longer keep the team from a more urgent goal."""
        first = self._made.instead_of
        if first is None:
            return False
        # Without this, a plan that something else prevents would be made again in each step.
        if _is_in_the_way(first, self.base.state, teammates):
            return not _is_in_the_way(first, past.state, teammates)
        late = past.step - self.base.step > LONG
        return late and facts_about(teammates.others, past.state) != self.base.others

    def _check_delay(self, past: PastStep, teammates: Teammates) -> PlanVerdict:
        """Check a plan that relies on the team: others may block it, or a member may do nothing."""
        script, state, team = self.script, past.state, teammates.team
        if state.goal_reached:
            return KEEP
        due = {p: script.due(p, state) for p in team if not state.busy_steps(p)}
        blocked = {p for p, a in due.items() if a and not state.world.applicable(state, a)}
        taken = {standing_at(state, player) for player in teammates.others}
        in_the_way = any(a and leads_to(a, taken) for a in due.values())
        # A running timer explains a blocked action; then nobody is in the way.
        held_up = in_the_way or (blocked and not past.is_running(team))
        self._blocked = self._blocked + 1 if held_up else 0
        self._count_standstill(past, team)
        if (blocked and past.is_meddling(team)) or self._blocked > self._patience:
            return DROP
        if not self.is_stuck:
            return PlanVerdict(unused=self._leaves_unused(teammates))
        # Members whose next action is possible but not taken are late; blocked ones are not to
        # blame. A bot that takes its time knows that it follows the plan.
        late = {p for p, a in due.items() if a and p not in blocked}
        if not late:
            return DROP
        if script.player in late or (teammates.hurried and self._stuck <= SLOW * self._patience):
            return KEEP
        return PlanVerdict(keep=False, without=frozenset(late))

    def _check_standstill(self, past: PastStep, teammates: Teammates) -> PlanVerdict:
        """Check a plan that relies on other players, who may have opened a way."""
        state = past.state
        self._count_standstill(past, teammates.team)
        # Two teams of bots that each wait for the other would wait forever, and a person may never
        # help. So a stuck team also tries the other assumption, and returns to the first one, whose
        # requests are the more likely ones. Each further attempt from the same situation searches
        # differently, after twice the pause.
        again = max(0, self._in_vain.get(situation(state), 0) - len(WAYS))
        patience = (self._patience if teammates.among_bots else LONG) << again
        due = past.step - self.base.step >= self._retry
        if (due and self._may_see_a_way(state, teammates)) or self._stuck > patience:
            return DROP
        if unused_members(self.idle) and self._leaves_unused(teammates):
            return PlanVerdict(unused=True)
        # Meddling may have changed what the plan needs, so a free way is not enough.
        if self.assumption is not Assumption.OTHERS_ASIDE or self._meddled:
            return KEEP
        if self._station_in_the_way(state, teammates) is not None:
            return KEEP
        if object_in_hand(self.script.rest(teammates.team), state, teammates.others) is not None:
            return KEEP
        # The others have stepped aside, so the plan now relies on the team alone.
        self.assumption = Assumption.TEAM
        return PlanVerdict(way_is_free=True)

    def _count_standstill(self, past: PastStep, team: Collection[str]) -> None:
        goes_on = past.has_acted(team) or past.is_running(team)
        self._stuck = 0 if goes_on else self._stuck + 1

    def _leaves_unused(self, teammates: Teammates) -> bool:
        """Return whether a member of a team next to others has done nothing for some time."""
        apart = teammates.hurried and teammates.others and len(teammates.team) > 1
        idle = [self.idle[player] for player in teammates.team]
        return bool(apart) and any(steps and not steps % UNUSED for steps in idle)

    def _may_see_a_way(self, state: State, teammates: Teammates) -> bool:
        """Return whether a change may have opened a way, or closed the expected one."""
        if self.assumption is Assumption.EVERYBODY:
            # Others who do their part of the plan are expected; only deviations count.
            meddled = not self.script.astray <= set(teammates.team)
        else:
            meddled = self._meddled
        walked = self._walked_elsewhere(state, teammates)
        done = self.script.is_finished(teammates.team) and state != self.base.state
        return meddled or walked or (done and not self._made.cut_off)

    def _walked_elsewhere(self, state: State, teammates: Teammates) -> bool:
        """Return whether walks of the others may have changed what the team can reach."""
        if self.assumption is Assumption.OTHERS_ASIDE:
            before = {standing_at(self.base.state, player) for player in teammates.others}
            # They may have left one place that the plan needs for another such place.
            return self._station_in_the_way(state, teammates) not in {None, *before}
        if facts_about(teammates.others, state) == self.base.others:
            return False
        if self.assumption is Assumption.NOTHING and not self._made.cut_off:
            return True
        opened = self._made.cut_off and not self._is_cut_off(state, teammates.team)
        return opened or self._made.aside_untried

    def _station_in_the_way(self, state: State, teammates: Teammates) -> str | None:
        return station_in_the_way(self.script.rest(teammates.team), state, teammates.others)


def facts_about(players: Collection[str], state: State) -> int:
    """Return the facts of a state about some players."""
    facts = 0
    for player in players:
        facts |= state.facts & state.world.table.mentions(player)
    return facts


def facts_apart_from(names: Collection[str], state: State) -> int:
    """Return the facts of a state about players and items, without those about some of them."""
    placed = scene(state).items()
    others = {*state.world.players, *(name for name, each in placed if each.host is not None)}
    return facts_about(others - {*names}, state) & ~facts_about(names, state)
