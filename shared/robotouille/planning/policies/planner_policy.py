"""A seat that plans for itself: alone, or with others that plan alike.

Planners in several seats make the same plan from the same state, each for the whole team, and each
plays its own part. What makes them plan anew is something that all of them are told, in the same
order: an action that the plan does not say, a step too many in which nothing goes on, somebody who
comes or says something. So they plan from the same state, whenever each gets around to it.

Whoever is not of the team is taken to stand still. Those that are left plan around them, anew
whenever they get in the way. Where there is no way, they ask for it, plan as if they had it, or as
if everybody were of the team, and do of that plan what can be done: nothing that would have to be
undone. Who waits for others meanwhile makes way for them. They plan anew only once somebody has
done what may help or hinder: not since somebody walks.
"""

from __future__ import annotations

import logging
import random
from collections import deque
from collections.abc import Mapping
from functools import cached_property

from robotouille.domain.rendering import NO_WORDS, Language, language_of
from robotouille.domain.task import Timing
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.plan import Plan
from robotouille.planning.policies.making_way import missing_deed, station_in_the_way
from robotouille.planning.policies.past_step import PastStep
from robotouille.planning.policies.plan_watch import Company, PlanBase, PlanWatch, facts_about
from robotouille.planning.policies.script import Did, Script
from robotouille.planning.policies.standing import (
    leads_to,
    standing_at,
    walks_aside,
    walks_out_of_the_way,
)
from robotouille.planning.policies.team_plan import Reliance, TeamPlanner
from robotouille.planning.policies.team_search import EXPANSIONS, NEAR, TeamSearch
from robotouille.planning.policies.team_talk import (
    TOLD,
    VERSION,
    Talk,
    announced_version,
    appeal,
    intention,
    request,
    requested,
)
from robotouille.planning.search_result import SearchResult
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.occupancy import Occupancy
from robotouille.world.people.wording import Wording
from robotouille.world.world import State, World

__all__ = ["PlannerPolicy"]

logger = logging.getLogger(__name__)

RECONSIDER = 4
"""Steps after which a team whose plan may be too long looks for a shorter one."""

MAX_CATCHING_UP = 3
"""Plans that are made for one decision, because what was done meanwhile was something else."""

RETRY, MAX_RETRY = 5, 40
"""Steps after which a plan is sought again where there was none, if others have done something;
twice as many each time that there is still none, up to a bound."""

POLITE = 3
"""Steps for which a seat waits for others where it stands, before it makes way."""

YIELDING = 4
"""Steps for which somebody who has made way stays away."""


class PlannerPolicy:
    """Chooses the actions of one seat by search on its own copy of the world.

    One seed, one course: nothing here reads a clock. `alone` counts on nobody else from the start,
    which makes decisions quicker; so does an `anytime` of the task that knows it already. It talks
    in the words of the domain, with `words` laid over them.

    `anticipating` says of the last action that another's in the same step is to make it possible.
    """

    def __init__(
        self,
        world: World,
        player: str,
        *,
        seed: int = 0,
        expansions: int = EXPANSIONS,
        alone: bool = False,
        anytime: AnytimePlanner | None = None,
        start: State | None = None,
        words: Language = NO_WORDS,
    ) -> None:
        self.player = player
        self._random = random.Random(f"{seed}:{player}")
        self._team = {player} if alone else set(world.players)
        self._unlike: set[str] = set()
        self._known: Mapping[str, str] = {}
        self._only = len(world.players) == 1
        self._punctual = world.task.timing is Timing.BENCHMARK
        self._hurried = not self._punctual
        self._lockstep = False
        self._anytime = anytime or AnytimePlanner(World(world.task))
        shared_seed = seed if alone or self._only else 0
        self._search = TeamSearch(self._anytime, shared_seed, expansions)
        self._silent = alone or self._only
        self._planner = TeamPlanner(self._anytime, self._search, alone=self._silent)
        self._world = world
        self._words = words
        self._state = start
        self._talk = Talk(silent=self._silent)
        self.anticipating = False
        self._watch: PlanWatch | None = None
        self._needed: PlanBase | None = None
        self._steps_left = 0
        self._may_improve = False
        self._in_vain: dict[State, int] = {}
        self._retry = RETRY
        self._unheeded: deque[PastStep] = deque()
        self._step = self._waited = self._yielding_until = 0
        self._drop_plan()

    # What the seat is told, in the same order as all others

    @property
    def has_plan(self) -> bool:
        """Whether the last search found a plan. Without one the seat does what would be right if
        others made way; if there is no plan even then, it comes as near to the goal as it can."""
        return self._watch is None or self._watch.relies_on is Reliance.TEAM

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        """Who moves each player now: `bot`, `human`, `model` and the like; and the clock. Only
        bots are counted on."""
        self._lockstep = clock == "lockstep"
        self._hurried = clock == "realtime"
        if self._silent:
            return
        before, self._known = self._known, dict(kinds)
        for player, kind in kinds.items():
            if player == self.player or kind == before.get(player, "bot"):
                continue
            self._unlike.discard(player)
            if kind == "bot":
                self._team.add(player)
            elif kind:
                self._leave_out({player})

    def hear(self, player: str, text: str) -> None:
        """What somebody says: a bot that plans alike, or a person who wants to get somewhere."""
        version = announced_version(text)
        if version == VERSION:
            self._unlike.discard(player)
            self._team |= {p for p in self._world.players if self._counted_on(p)}
            if self._step:
                self._drop_plan()
        elif version is not None:
            self._unlike.add(player)
            self._leave_out({player})
        elif player not in self._team and self._state is not None:
            station = standing_at(self._state, self.player)
            if station is not None and requested(text, station, self._state, self._wording):
                self._yielding_until = self._step + YIELDING

    def observe(self, did: Did) -> None:
        """What everybody did in a step; called once for each step before `act`."""
        self._step += 1
        own = [(player, self._own(action), applied) for player, action, applied in did]
        if self._state is not None:
            self._state = self._state.step([a for _, a, applied in own if applied]).state
            self._unheeded.append(PastStep(self._step, self._state, own))
            self._catch_up()

    def _catch_up(self) -> None:
        """Go through what has happened since the plan was found to be needed, as those have that
        had it at once."""
        while self._unheeded:
            watch = self._followed
            if watch is None:
                return
            past = self._unheeded.popleft()
            self._steps_left -= 1
            verdict = watch.heed(past, self._company)
            if verdict.way_is_free:
                self._talk.met()
            if self.player in verdict.without:
                self._talk.announce()
            self._team -= verdict.without - {self.player}
            if not verdict.keeps:
                self._drop_plan(past)

    def speak(self) -> list[str]:
        """What there is to be said since this was last asked; what is asked of others, as it is
        now."""
        if self._talk.may_ask(self._step):
            wish = self._wish()
            if wish:
                self._talk.ask(wish, self._step)
        return self._talk.speak()

    def _wish(self) -> str:
        """What this seat asks of others for the team, in the present state."""
        state, watch = self._state, self._followed
        if state is None or watch is None or state.goal_reached or self.player != min(self._team):
            return ""
        others = self._outsiders
        deed = None
        if watch.relies_on is Reliance.EVERYBODY and watch.is_stuck:
            deed = missing_deed(watch.script, state, others, self._rules)
        elif watch.relies_on is not Reliance.OTHERS_ASIDE:
            return ""
        if deed is not None:
            return appeal(self._own(deed), state, self._wording)
        station = station_in_the_way(watch.script.rest(self._team), state, others)
        return "" if station is None else request(station, state, self._wording)

    def _counted_on(self, player: str) -> bool:
        return player not in self._unlike and self._known.get(player, "bot") in ("bot", "")

    def _own(self, action: GroundAction) -> GroundAction:
        """An action of another copy of the world."""
        if action.source is self._world:
            return action
        self._world.admit(action.arguments)
        return self._world.action(action.name, *action.arguments)

    @property
    def _followed(self) -> PlanWatch | None:
        """The plan that is followed; None where another one is needed."""
        return self._watch if self._needed is None else None

    @property
    def _script(self) -> Script | None:
        """This seat's part of it."""
        return None if self._followed is None else self._followed.script

    def _drop_plan(self, past: PastStep | None = None) -> None:
        """Follow the plan no more. Once an action is asked for, another one is made: from here, or
        from a step that has passed."""
        if past is None:
            self._unheeded.clear()
        step, state = (self._step, self._state) if past is None else (past.step, past.state)
        if state is not None:
            self._needed = PlanBase(step, state, facts_about(self._outsiders, state))
        self._waited = 0

    def _leave_out(self, players: set[str]) -> None:
        """Do not count on some players any more."""
        players = players & self._team - {self.player}
        if players:
            self._team -= players
            self._drop_plan()

    # What the seat does

    def act(self, state: State) -> GroundAction | None:
        """The action to take in a state; None to do nothing this step."""
        self.anticipating = False
        if self._state is None or self._state != state:
            returning = self._state is not None
            self._state = state
            self._drop_plan()
            if returning:
                self._talk.announce()
        self._state = state
        if state.goal_reached or state.busy_steps(self.player):
            return None
        if self._yielding_until > self._step:
            return self._step_aside(state)
        for _ in range(MAX_CATCHING_UP):
            if self._needed is not None:
                self._make_plan(self._needed)
                self._catch_up()  # What was done meanwhile may be against the plan.
        if self._script is None:
            return None
        if self._may_improve and self._only:
            self._improve(state)
        elif self._may_improve and self._step % RECONSIDER == 0:
            self._improve_together(state)
        action = self._scripted(state)
        if action is None and self._is_idle(state):
            return self._step_aside(state)
        if self._waits_for_others(state, action):
            self._waited += 1
            return self._make_way(state)
        self._waited = 0
        self._tell_others(action)
        return action

    @property
    def waiting(self) -> bool:
        """Whether, where the last `act` was to do nothing, that is since a place is not free, since
        somebody has to come first, or since there is no way past the others; not for an effect that
        runs."""
        state, script = self._state, self._script
        if state is None or state.goal_reached or state.busy_steps(self.player):
            return False
        if script is None or self._waited or self._yielding_until > self._step:
            return True
        return script.waits(state) or (script.finished and not (self.has_plan or self._only))

    def _scripted(self, state: State) -> GroundAction | None:
        watch = self._followed
        if watch is None:
            return None
        if not self._lockstep or watch.relies_on is Reliance.EVERYBODY:
            return watch.script.act(state)
        action, self.anticipating = watch.script.joint(state).get(self.player, (None, False))
        return action

    def _make_plan(self, base: PlanBase) -> None:
        """Make a plan from where it was found to be needed, and follow it."""
        tried = self._in_vain.get(base.state, 0)
        made = self._planner.make(base.state, self._team, hurried=self._hurried, tried=tried)
        self._may_improve = False
        if made.relies_on is Reliance.TEAM:
            self._talk.met()
            self._in_vain.clear()
            self._may_improve = self._punctual and self._is_worth_improving(made.found)
        else:
            logger.debug("%s finds no plan from here", self.player)
            self._in_vain[base.state] = tried + 1
        helpless = made.relies_on is Reliance.NOTHING and not made.found.unsolvable
        self._retry = min(2 * self._retry, MAX_RETRY) if helpless else RETRY
        if helpless and self._outsiders and self.player == min(self._team):
            self._talk.despair()
        self._watch = PlanWatch(
            made,
            self._part_of(made.plan, made.base),
            base,
            retry=self._retry,
            in_vain=self._in_vain,
            is_cut_off=self._anytime.is_cut_off,
        )
        self._needed = None

    def _improve(self, state: State) -> None:
        """Take what time there is at every decision to look for a shorter plan for the rest.

        Only where steps are those of the plan: elsewhere lengths say little about time. And only
        where there are no other seats, whose parts a shorter plan would count on.
        """
        for result in self._search.shorter(state):
            if result.plan is not None and len(result.plan) < self._steps_left:
                self._follow_instead(result.plan, state)
            self._may_improve = result.plan is None or self._steps_left > result.bound

    def _is_worth_improving(self, result: SearchResult) -> bool:
        """A player who is alone always tries; a team that decides together, if there is a bound."""
        if self._only or len(self._team) == 1 or not self._lockstep:
            return self._only and not result.optimal
        return result.bound > 0 and self._steps_left > NEAR * result.bound

    def _improve_together(self, state: State) -> None:
        """Look for a shorter plan for the rest: all of the team do, in the same step."""
        team = tuple(sorted(self._team))
        found = self._search.once(state, team, self._planner.effort(team), after=self._step)
        if found.plan is not None and len(found.plan) < self._steps_left:
            self._follow_instead(found.plan, state)
        self._may_improve = self._steps_left > NEAR * found.bound

    def _follow_instead(self, plan: Plan, state: State) -> None:
        """Follow a shorter plan for the rest."""
        if self._followed is not None:
            self._followed.script = self._part_of(plan, state)

    def _part_of(self, plan: Plan, base: State) -> Script:
        """This seat's part of a plan that is to be followed from now on."""
        direct = self._hurried and bool(self._outsiders)
        self._steps_left = len(plan)
        return Script(self.player, plan, self._anytime.in_model(base), direct=direct)

    # Others who are no planners

    @cached_property
    def _wording(self) -> Wording:
        """The words for those who are no planners."""
        return Wording(self._world, language_of(self._world.task).with_words(self._words))

    @cached_property
    def _rules(self) -> Occupancy:
        return Occupancy(self._world)

    @property
    def _outsiders(self) -> list[str]:
        return [p for p in self._world.players if p not in self._team]

    @property
    def _company(self) -> Company:
        others = self._outsiders
        among_bots = any(self._known.get(p, "bot") in ("bot", "") for p in others)
        return Company(self._team, others, among_bots=among_bots, hurried=self._hurried)

    def _is_idle(self, state: State) -> bool:
        """Whether the seat has nothing to do, and may be in the way of others."""
        if self._only or self._script is None or not self._script.finished:
            return False
        return bool(self._outsiders)

    def _step_aside(self, state: State) -> GroundAction | None:
        """Walk to where nobody wants to be, unless the seat is there."""
        walks = walks_aside(state, self.player)
        return self._random.choice(walks) if walks else None

    def _waits_for_others(self, state: State, action: GroundAction | None) -> bool:
        """Whether what the seat has left to do has to wait for somebody who is not of the team: for
        their part of the plan, or since they stand where it is about to go."""
        watch, others = self._followed, self._outsiders
        if watch is None or not others or watch.script.finished:
            return False
        script = watch.script
        at_work = action is not None and action.destination is None
        if not at_work and watch.relies_on is Reliance.EVERYBODY and script.waits_for(others):
            return True
        due = script.due(self.player, state) if action is None else None
        return due is not None and leads_to(due, {standing_at(state, p) for p in others})

    def _make_way(self, state: State) -> GroundAction | None:
        """Stand where nobody wants to be while one waits, if that lasts."""
        walks = walks_out_of_the_way(state, self.player) if self._waited >= POLITE else []
        return self._random.choice(walks) if walks else None

    def _tell_others(self, action: GroundAction | None) -> None:
        """Tell people and others who cannot know where this seat is about to go."""
        if action is None or self._script is None or action.destination is None:
            return
        others = [p for p in self._outsiders if self._known.get(p) in ("human", "model", "bot")]
        may = self._talk.may_tell(self._step, hurried=self._hurried)
        if others and self._state is not None and may:
            coming = [self._own(each) for each in self._script.coming(TOLD)]
            self._talk.tell(intention(coming, self._state, self._wording), self._step)
