"""A policy that plans for its seat, alone or together with other planner bots.

Planner bots in several seats make the same plan from the same state, each for the whole team, and
each plays its own part (docs/decisions/0029-identical-team-plans.md). The bots plan again only
after events that all of them receive in the same order: an unplanned action, too many steps without
progress, a change of participants, or a chat message. So all of them plan from the same state, even
if some take longer.

The bots assume that participants outside the team stand still, and plan around them. If there is no
such plan, the bots ask the others for help and plan as if the others stepped aside, or as if the
others were in the team. The bots execute the part of that plan that never has to be undone, and
make way while they wait (docs/decisions/0038-bots-with-people.md).

In a game that continues during planning, a bot acts between two searches: it goes on with its last
plan, or makes way (docs/decisions/0051-planning-in-portions.md).
"""

from __future__ import annotations

import logging
import math
import random
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from robotouille.domain.rendering import NO_WORDS, Language
from robotouille.domain.task import Timing
from robotouille.planning.plan import Plan, SearchResult
from robotouille.planning.policies.agenda import Agenda, Aim, OneGoal
from robotouille.planning.policies.aside import after, holds
from robotouille.planning.policies.company import Company
from robotouille.planning.policies.conversation import Conversation
from robotouille.planning.policies.courtesy import Courtesy
from robotouille.planning.policies.deliberation import Deliberation
from robotouille.planning.policies.making_way import MakingWay
from robotouille.planning.policies.plan_watch import (
    PastStep,
    PlanBase,
    PlanWatch,
    Situation,
    facts_about,
    situation,
    unused_members,
)
from robotouille.planning.policies.policy import Did, Script, Speech, does_something
from robotouille.planning.policies.standing import (
    leads_to,
    standing_at,
)
from robotouille.planning.policies.team_plan import (
    EXPANSIONS,
    NEAR,
    PORTION,
    Assumption,
    Portion,
    TeamDecision,
    TeamPlan,
    TeamSearch,
    station_in_the_way,
)
from robotouille.planning.policies.team_talk import VERSION, announced_version
from robotouille.planning.solvers import AnytimePlanner
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.signals import Intent, Signal
from robotouille.world.world import State, World

logger = logging.getLogger(__name__)

RECONSIDER = 4
"""Steps between two searches for a shorter plan of a team."""

# Actions that arrive during planning can invalidate the new plan. One decision makes at most this
# many plans.
MAX_CATCHING_UP = 3

# A search that found no plan is repeated after this many steps, if others have acted. Each failure
# doubles the number up to the maximum, since the same obstacle usually persists.
RETRY, MAX_RETRY = 5, 25

RECENT = 25
"""Steps for which participants who did something other than walk are expected to do more."""

MAX_WORKED = 64
"""Number of actions of other participants that are remembered."""

PASSING = 5
"""Steps for which a plan needs others to step aside or help before the team asks in real time."""

PENSIVE = 2
"""Steps of planning without another action after which a seat makes way."""


@dataclass(frozen=True, slots=True)
class PlannerOptions:
    """Options of a planner policy.

    `alone` ignores all other seats, which makes decisions quicker. `words` replaces words of the
    domain in chat messages.
    """

    seed: int = 0
    expansions: int = EXPANSIONS
    alone: bool = False
    words: Language = NO_WORDS


DEFAULT_OPTIONS = PlannerOptions()


class PlannerPolicy:
    """Policy that chooses the actions of one seat by search on its own copy of the world.

    Equal seeds and events give equal actions, because the policy reads no clock. `anticipating` is
    true if the last action relies on another seat's action in the same step.

    Args:
        anytime: Planner of the task that several policies share, so that the task is analysed once.
        agenda: The goals of the seat; by default the goal of the task.
        start: The state from which `observe` follows the game.
    """

    def __init__(
        self,
        world: World,
        player: str,
        options: PlannerOptions = DEFAULT_OPTIONS,
        *,
        anytime: AnytimePlanner | None = None,
        agenda: Agenda | None = None,
        start: State | None = None,
    ) -> None:
        self.player = player
        self._company = Company(player, world.players, alone=options.alone)
        self._only = len(world.players) == 1
        self._punctual = world.task.timing is Timing.BENCHMARK
        # This is a guess until `meet` sets the clock: real-time games use the timing `people`.
        self._hurried = not self._punctual
        self._lockstep = False
        self._agenda = agenda or OneGoal(anytime or AnytimePlanner(World(world.task)))
        self._aims: dict[AnytimePlanner, Aim] = {}
        self._silent = options.alone or self._only
        self._options = options
        self._world = world
        self._state = start
        self._talk = Conversation(world, player, options.words, silent=self._silent)
        self.anticipating = False
        self._watch: PlanWatch | None = None
        self._needed: PlanBase | None = None
        self._deliberation: Deliberation | None = None
        self._steps_left = 0
        self._may_improve = False
        self._in_vain: dict[Situation, int] = {}
        self._rest: TeamPlan | None = None
        self._pursued: Aim | None = None
        self._retry = RETRY
        self._unprocessed: deque[PastStep] = deque()
        self._worked: deque[tuple[int, str]] = deque(maxlen=MAX_WORKED)
        self._step = 0
        self._way = MakingWay(player, random.Random(f"{options.seed}:{player}"))
        self._courtesy = Courtesy(player, self._way.step_aside)
        self._drop_plan()

    # Events, which arrive in the same order at every seat

    @property
    def has_plan(self) -> bool:
        """True if the last search found a plan that relies on the team alone."""
        return self._watch is None or self._watch.assumption is Assumption.TEAM

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        """Set the clock and the kind of each seat's participant. Only bots can be in the team."""
        self._lockstep = clock == "lockstep"
        self._hurried = clock == "realtime"
        if self._silent:
            return
        if self._company.meet(kinds):
            self._drop_plan()

    def hear(self, player: str, speech: Speech) -> None:
        """Process a bot's announcement of its version, or a request."""
        if speech.to_bots:
            self._hear_version(player, announced_version(speech.text))
        elif player not in self._company.team and self._state is not None:
            signal = self._talk.meaning(speech, self._state)
            if signal is not None:
                self._heed(player, signal, self._state)

    def _hear_version(self, player: str, version: int | None) -> None:
        if version == VERSION:
            self._company.add_alike(player)
            # Before the first step there is no plan to replace.
            if self._step:
                self._drop_plan()
        elif version is not None and self._company.leave_out_unlike(player):
            self._drop_plan()

    def _heed(self, player: str, signal: Signal, state: State) -> None:
        self._courtesy.asked(signal, state, self._step)
        if signal.intent is Intent.YOURS:
            self._talk.ask_about(signal.target)
            if self._followed is not None and self._followed.assumption is Assumption.EVERYBODY:
                # The team no longer expects the player to help.
                self._worked = deque((w for w in self._worked if w[1] != player), MAX_WORKED)
                self._in_vain.clear()
                self._drop_plan()

    def observe(self, did: Did) -> None:
        """Process all actions of a step. Called once for each step, before `act`."""
        self._step += 1
        own = [(player, self._own(action), applied) for player, action, applied in did]
        for each, action, applied in own:
            if applied and each == self.player and action.destination is None:
                self._way.worked_with(action.arguments)
            if applied and each not in self._company.team and does_something(action):
                self._talk.allow_repetition()
                if action.destination is None:
                    self._worked.append((self._step, each))
        if self._state is not None:
            self._state = self._state.step([a for _, a, applied in own if applied]).state
            self._unprocessed.append(PastStep(self._step, self._state, own))
            if self._needed is not None:
                self._observe_outdated(own)
            self._catch_up()

    def _catch_up(self) -> None:
        """Process the steps since a plan became necessary."""
        # Each missed step is checked separately, so that this seat reaches the same conclusions as
        # seats that finished planning earlier.
        while self._unprocessed:
            watch = self._followed
            if watch is None:
                return
            past = self._unprocessed.popleft()
            if self._has_other_goals(watch, past.state):
                self._drop_plan(past)
                return
            self._steps_left -= 1
            verdict = watch.check(past, self._company.teammates(hurried=self._hurried))
            if verdict.way_is_free:
                self._talk.give_thanks()
                self._talk.clear_requests()
            if self.player in verdict.without:
                self._talk.announce()
            self._company.leave_out(verdict.without)
            if not verdict.keep:
                self._drop_plan(past)
            elif verdict.unused and self._pursued is not None:
                here = self._pursued.anytime.in_model(past.state)
                self._drop_plan(past, watch.rest(here, self._company.outsiders))

    def speak(self) -> list[Speech]:
        """Return what this seat says since the last call."""
        state, watch = self._state, self._followed
        if state is not None and watch is not None and not state.goal_reached:
            self._talk.answer(watch.script, state, self._company.team)
            # In real time, a person who passes by leaves a place before it could be asked for.
            passing = self._hurried and self._step - watch.base.step < PASSING
            if self._company.spokesman and not passing:
                team, others = self._company.team, self._company.outsiders
                self._talk.ask_for_help(watch, state, self._step, team, others)
        return self._talk.speak(among_bots=self._company.has_bots())

    def _own(self, action: GroundAction) -> GroundAction:
        """Return an action of another copy of the world as an action of this one."""
        if action.source is self._world:
            return action
        self._world.admit(action.arguments)
        return self._world.action(action.name, *action.arguments)

    @property
    def _followed(self) -> PlanWatch | None:
        """The followed plan, or None if a new one is needed."""
        return self._watch if self._needed is None else None

    @property
    def _script(self) -> Script | None:
        """This seat's part of the followed plan."""
        return None if self._followed is None else self._followed.script

    def _drop_plan(self, past: PastStep | None = None, rest: TeamPlan | None = None) -> None:
        """Stop following the plan; the next `act` makes one from the current or a past step.

        Args:
            rest: The rest of the plan, which only a better plan may replace.
        """
        # All seats of the team notice a deviation in the same step, and plan from that step. So
        # they make the same plan.
        if self._needed is None:
            for later in self._unprocessed:
                self._observe_outdated(later.did)
        if past is None:
            self._unprocessed.clear()
        self._deliberation, self._rest = None, rest
        step, state = (self._step, self._state) if past is None else (past.step, past.state)
        # Members who join know nothing of earlier steps, so only plans after a check count them.
        idle = {} if past is None or self._watch is None else self._watch.idle
        if state is not None:
            self._needed = PlanBase(step, state, facts_about(self._company.outsiders, state), idle)
        self._way.waited = 0

    def _observe_outdated(self, did: Did) -> None:
        """Let the script of a dropped plan, which the seat follows during planning, go on."""
        if self._watch is not None:
            self._watch.script.observe(did, self._world.players)

    def _has_other_goals(self, watch: PlanWatch, state: State) -> bool:
        """Return whether a team has to plan again because of its goals."""
        agenda, before = self._agenda, watch.base.state
        if agenda.topic(state) != agenda.topic(before):
            return True
        # A team that waits can work for a goal that is not urgent.
        return watch.assumption is not Assumption.TEAM and agenda.goals(state) != agenda.goals(
            before
        )

    def _aim(self, anytime: AnytimePlanner) -> Aim:
        known = self._aims.get(anytime)
        if known is None:
            # The bots of a team must find the same plan, so they share the seed 0.
            seed = self._options.seed if self._silent else 0
            known = self._aims[anytime] = Aim(
                anytime, seed=seed, expansions=self._options.expansions, alone=self._silent
            )
        return known

    # Actions of the seat

    def act(self, state: State) -> GroundAction | None:
        """Return the action to take in a state, or None to do nothing in this step."""
        self.anticipating = False
        self._enter(state)
        # A busy player's actions are rejected, so planning can wait.
        if state.goal_reached or state.busy_steps(self.player):
            return None
        if self._courtesy.at_work(self._step):
            return self._courtesy.act(state, self._step)
        self._go_on_planning()
        if self._script is None:
            return self._act_meanwhile(state)
        if self._may_improve and self._pursued is not None:
            if self._only:
                self._improve(state, self._pursued.search)
            elif self._step % RECONSIDER == 0:
                self._improve_together(state, self._pursued)
        action = self._scripted(state)
        if action is not None and self._courtesy.refrains(action, state, self._step):
            return self._way.step_aside(state)
        if action is None and self._is_idle(state):
            return self._way.step_aside(state)
        if self._watch is not None and self._waits_for_others(self._watch, state, action):
            self._way.waited += 1
            return self._way.act(state, self._company.team, hurried=self._hurried)
        self._way.waited = 0
        self._announce_actions(action)
        return action

    def think(self, state: State) -> None:
        """Plan in a state in which the seat may not act, such as in a pause.

        The other bots of the team plan at this time, too. A seat that planned only after its pause
        would first follow an outdated plan, and the others would no longer count on it.
        """
        self._enter(state)
        if self._hurried and not state.goal_reached:
            self._go_on_planning()

    def _enter(self, state: State) -> None:
        if self._state is None or self._state != state:
            # The game is not in the state that `observe` predicts: the seat has joined, or returned
            # after an absence.
            returning = self._state is not None
            self._state = state
            self._drop_plan()
            if returning:
                self._talk.announce()
        self._state = state

    def _go_on_planning(self) -> None:
        # The steps that passed during planning may already contradict the new plan.
        # Without any plan, a bot that acts could only walk aside, so the first analysis is at once.
        portion = Portion(PORTION if self._hurried else math.inf, analysis=self._step > 0)
        for _ in range(MAX_CATCHING_UP):
            if self._needed is not None and self._make_plan(self._needed, portion):
                self._catch_up()

    @property
    def waiting(self) -> bool:
        """True if the last `act` did nothing because of a blocked station or another participant.

        Waiting for a running effect does not count.
        """
        state, script = self._state, self._script
        if state is None or state.goal_reached or state.busy_steps(self.player):
            return False
        if self._deliberation is not None:
            # A seat that plans again still waits for what its last plan relies on.
            return not self.has_plan
        if self._pursued is None:
            return False  # Without an open order, nothing has to be done.
        if script is None or self._way.waited or self._courtesy.at_work(self._step):
            return True
        if self._watch is not None and self._would_take_in_vain(self._watch, state):
            return True
        return script.waits(state) or (script.finished and not (self.has_plan or self._only))

    def _scripted(self, state: State) -> GroundAction | None:
        watch = self._followed
        if watch is None:
            return None
        # In lockstep all seats decide at the same time, so an action may rely on another one of
        # the same step (`act.anticipates`). Only actions of the team are certain enough for that.
        if self._would_take_in_vain(watch, state):
            return None
        if not self._lockstep or watch.assumption is Assumption.EVERYBODY:
            return watch.script.act(state)
        action, self.anticipating = watch.script.joint(state).get(self.player, (None, False))
        return action

    def _would_take_in_vain(self, watch: PlanWatch, state: State) -> bool:
        """Return whether the seat would take an object that it could not use now.

        Another player stands where it is needed, or the seat has just laid it down in vain.
        """
        if not self._hurried or watch.assumption is Assumption.TEAM or holds(state, self.player):
            return False
        action = watch.script.non_move_action(self.player)
        # An object in hand would keep the seat from other work. Cutting or boiling does not.
        if action is None or not holds(after(state, self._own(action)), self.player):
            return False
        if self._way.takes_back(action, state, self._company.team):
            return True
        if watch.assumption is not Assumption.OTHERS_ASIDE:
            return False
        others = self._company.outsiders
        return station_in_the_way(watch.script.errand(), state, others) is not None

    def _act_meanwhile(self, state: State) -> GroundAction | None:
        """Return an action during planning: one of the last plan, or a walk out of the way."""
        if self._deliberation is None:
            return None
        watch = self._watch
        if watch is not None and not self._has_other_goals(watch, state):
            action = None if self._would_take_in_vain(watch, state) else watch.script.act(state)
            if action is not None and not self._waits_for_others(watch, state, action):
                return action
        # Most decisions end in the next step, for which a walk would take too long.
        self._way.waited += 1
        may_go = self._company.outsiders and self._way.waited >= PENSIVE
        return self._way.step_aside(state) if may_go else None

    def _deliberate(self, base: PlanBase) -> Deliberation:
        tried = self._in_vain.get(situation(base.state), 0)
        working = {p for step, p in self._worked if base.step - RECENT < step <= base.step}

        def decide(aim: Aim) -> TeamDecision:
            return aim.planner.decide(
                base.state,
                self._company.team,
                hurried=self._hurried,
                tried=tried,
                working=working,
                rest=self._rest if aim is self._pursued else None,
                unused=unused_members(base.idle) if self._hurried else (),
            )

        aims = [self._aim(goal) for goal in self._agenda.goals(base.state)]
        return Deliberation(base.state, aims, tried, decide)

    def _make_plan(self, base: PlanBase, portion: Portion) -> bool:
        """Make a plan from the state in which it became necessary, and follow it.

        Return False if the portion is too small.
        """
        deliberation = self._deliberation = self._deliberation or self._deliberate(base)
        choice = deliberation.go_on(portion)
        if choice is None:
            return False
        self._deliberation = None
        made, self._pursued = choice
        self._may_improve = False
        if self._pursued is None:
            pass  # Without a goal, nothing was tried.
        elif made.assumption is Assumption.TEAM:
            self._talk.clear_requests()
            self._in_vain.clear()
            self._may_improve = self._punctual and self._is_worth_improving(made.found)
        else:
            logger.debug("%s finds no plan from here", self.player)
            # The next plan from this state tries the other assumption first.
            self._in_vain[situation(base.state)] = deliberation.tried + 1
        # After a proof that the goal is out of reach, another search would be useless.
        stuck = made.assumption is Assumption.NOTHING and not made.found.unsolvable
        helpless = stuck and self._pursued is not None
        self._retry = min(2 * self._retry, MAX_RETRY) if helpless else RETRY
        lasting = self._world.shift is None
        if helpless and lasting and self._company.outsiders and self._company.spokesman:
            self._talk.report_no_plan()
        self._watch = PlanWatch(
            made,
            self._part_of(made.plan, made.base),
            base,
            retry=self._retry,
            in_vain=self._in_vain,
            is_cut_off=self._is_cut_off,
        )
        self._needed = None
        return True

    def _is_cut_off(self, state: State, team: Collection[str]) -> bool:
        return self._pursued is not None and self._pursued.anytime.is_cut_off(state, team)

    def _improve(self, state: State, search: TeamSearch) -> None:
        """Search for a shorter remaining plan of a single seat."""
        # Callers use this only with the timing `benchmark`, because other plan lengths say little
        # about time, and for a single seat, because other seats would have to change their parts.
        for result in search.shorter(state):
            if result.plan is not None and len(result.plan) < self._steps_left:
                self._follow_instead(result.plan, state)
            self._may_improve = result.plan is None or self._steps_left > result.bound

    def _is_worth_improving(self, result: SearchResult) -> bool:
        """Return whether a search for a shorter plan may pay off."""
        if self._only or len(self._company.team) == 1 or not self._lockstep:
            return self._only and not result.optimal
        # Without a bound, such as for three players, a team would search again and again in vain.
        return result.bound > 0 and self._steps_left > NEAR * result.bound

    def _improve_together(self, state: State, aim: Aim) -> None:
        """Search for a shorter remaining plan. All bots of the team do so in the same step."""
        team = tuple(sorted(self._company.team))
        found = aim.search.once(state, team, aim.planner.effort(team), after=self._step)
        if found.plan is not None and len(found.plan) < self._steps_left:
            self._follow_instead(found.plan, state)
        self._may_improve = self._steps_left > NEAR * found.bound

    def _follow_instead(self, plan: Plan, state: State) -> None:
        """Replace the followed plan by a shorter one."""
        if self._followed is not None:
            self._followed.script = self._part_of(plan, state)

    def _part_of(self, plan: Plan, base: State) -> Script:
        """Return this seat's part of a new plan."""
        direct = self._hurried and bool(self._company.outsiders)
        self._steps_left = len(plan)
        if self._pursued is not None:
            base = self._pursued.anytime.in_model(base)
        return Script(self.player, plan, base, direct=direct)

    # Participants outside the team

    def _is_idle(self, state: State) -> bool:
        """Return whether the seat has nothing to do and may be in the way of others."""
        if self._only or self._script is None or not self._script.finished:
            return False
        return bool(self._company.outsiders)

    def _waits_for_others(
        self, watch: PlanWatch, state: State, action: GroundAction | None
    ) -> bool:
        """Return whether a plan makes the seat wait for participants outside the team."""
        others = self._company.outsiders
        if not others or watch.script.finished:
            return False
        if self._would_take_in_vain(watch, state):
            return True
        script = watch.script
        at_work = action is not None and action.destination is None
        if not at_work and watch.assumption is Assumption.EVERYBODY and script.waits_for(others):
            return True
        due = script.due(self.player, state) if action is None else None
        return due is not None and leads_to(due, {standing_at(state, p) for p in others})

    def _announce_actions(self, action: GroundAction | None) -> None:
        """Announce the seat's next actions to participants who cannot compute them."""
        if action is None or self._script is None or action.destination is None:
            return
        may = self._talk.may_announce_actions(self._step, hurried=self._hurried)
        if may and self._state is not None and self._company.has_listeners():
            self._talk.announce_script(self._script, self._state, self._step)
