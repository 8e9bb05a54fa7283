"""Simulated people for games with bots: idle or helpful ones, and some who are in the way."""

from __future__ import annotations

import random
import sys
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import NamedTuple

from robotouille import GroundAction, State, World
from robotouille.domain.rendering import language_of
from robotouille.planning.plan import Plan
from robotouille.planning.policies.agenda import Agenda, OneGoal, OpenOrders
from robotouille.planning.policies.aside import holds, put_down, with_others_aside
from robotouille.planning.policies.policy import Did, Policy, Script, Speech, does_something
from robotouille.planning.policies.skill import Skill, SkilledPolicy
from robotouille.planning.policies.standing import standing_at, walks_out_of_the_way
from robotouille.planning.policies.team_plan import BRIEF, HURRIED
from robotouille.planning.policies.team_talk import requested
from robotouille.planning.solvers import AnytimePlanner
from robotouille.world.presentation.wording import Wording
from robotouille.world.shift import OpenOrder
from tests.support.team_games import Idle

RATE = 5.0
"""Steps per second."""
HELPLESS = int(10 * RATE)
"""Steps without a chance to go on after which a cook puts things down and steps aside."""
OBVIOUS = 6
"""Steps of a plan that people see at once."""


class Wanderer(Idle):
    """Walks to a random place every one to three seconds."""

    def __init__(self, player: str, seed: int) -> None:
        super().__init__(player)
        self._random, self._pause = random.Random(f"{seed}:{player}"), 0

    def act(self, state: State) -> GroundAction | None:
        self._pause -= 1
        walks = [a for a in state.actions(self.player) if a.destination]
        if self._pause > 0 or not walks:
            return None
        self._pause = self._random.randint(5, 15)
        return self._random.choice(walks)


class Hoarder(Wanderer):
    """Picks up the first thing it finds and carries it around; puts it down after a minute."""

    def __init__(self, player: str, seed: int) -> None:
        super().__init__(player, seed)
        self._step = 0

    def act(self, state: State) -> GroundAction | None:
        self._step += 1
        actions = state.actions(self.player)
        puts = [a for a in actions if a.name.startswith(("place", "stack"))]
        takes = [a for a in actions if a.name.startswith(("pick", "unstack"))]
        if puts and self._step > 60 * RATE:
            self._step = -10_000
            return puts[0]
        if takes and 0 <= self._step <= 60 * RATE:
            return takes[0]
        return super().act(state)


class Keeper(Hoarder):
    """Picks up the first thing it finds, and carries it around to the end."""

    def act(self, state: State) -> GroundAction | None:
        self._step = 0
        return super().act(state)


class Blocker(Idle):
    """Walks to a place of work and stays there, for some steps or to the end."""

    def __init__(self, player: str, kinds: tuple[str, ...], steps: int = sys.maxsize) -> None:
        super().__init__(player)
        self._kinds, self._steps = kinds, steps

    def act(self, state: State) -> GroundAction | None:
        self._steps -= 1
        if self._steps < 0:
            away = walks_out_of_the_way(state, self.player)
            return away[0] if away else None
        if (standing_at(state, self.player) or "").startswith(self._kinds):
            return None
        walks = [a for a in state.actions(self.player) if a.destination]
        wanted = [w for w in walks if str(w.destination).startswith(self._kinds)]
        return wanted[0] if wanted else None


class Cook:
    """Does one piece of work after the other, as someone would who sees only the kitchen.

    The piece is the own part of a plan for everybody. After three seconds without a chance to go
    on, it is a piece that is possible while the others stand still, or a step out of the way.

    Args:
        agenda: Goals that the cook reaches without help; by default the goals of the bots.
    """

    def __init__(self, world: World, player: str, agenda: Agenda | None = None) -> None:
        self._player = player
        self._counts_on_others = agenda is None
        self._in_shift = world.shift is not None
        self._agenda = agenda or _common_agenda(world)
        self._topic: Hashable = None
        self._script: Script | None = None
        self._hands_full = False
        self._idle = self._planned = 0

    def observe(self, did: Did) -> None:
        self._idle += 1
        if self._script is not None:
            self._script.observe(did, [player for player, _, _ in did])
        if any(p == self._player and ok and does_something(action) for p, action, ok in did):
            self._idle = self._planned = 0

    def act(self, state: State) -> GroundAction | None:
        full = holds(state, self._player)
        done = self._hands_full and not full
        self._hands_full = full
        if self._agenda.topic(state) != self._topic:
            self._topic, self._script = self._agenda.topic(state), None
            self._idle = self._planned = 0
        if self._idle > HELPLESS:
            self._script = None
            away = [*put_down(state, self._player), *walks_out_of_the_way(state, self._player)]
            return away[0] if away else None
        stuck = self._idle - self._planned > 3 * RATE
        script = self._script
        if script is None or script.finished or script.astray or done or stuck:
            script = self._script = self._plan(state, alone=stuck)
            self._planned = self._idle
        return script.act(state)

    def is_at_work(self, state: State) -> bool:
        """Return whether the next action is possible where the cook stands."""
        action = None if self._script is None else self._script.act(state)
        return action is not None and action.destination is None

    def _plan(self, state: State, *, alone: bool) -> Script:
        for anytime in self._agenda.goals(state)[:1]:
            here = anytime.in_model(state)
            aside = with_others_aside(here, [p for p in here.world.players if p != self._player])
            plan, start = self._search(anytime, aside, (self._player,)), aside
            # Everybody sees that a dish is nearly ready.
            together = self._counts_on_others and not alone
            if together and len(plan) not in range(1, OBVIOUS + 1):
                plan, start = self._search(anytime, here, tuple(here.world.players)), here
            return Script(self._player, plan, start, direct=True)
        return Script(self._player, Plan(()), state)

    def _search(self, anytime: AnytimePlanner, start: State, team: tuple[str, ...]) -> Plan:
        # Behind a counter, most dishes need both players; a long search finds that out, too.
        brief = self._in_shift
        search = anytime.search(start, HURRIED, team=team, beam=BRIEF, choices=6, brief=brief)
        return next(search).plan or Plan(())


def _common_agenda(world: World) -> Agenda:
    if world.shift is not None:
        return OpenOrders(world, {})
    return OneGoal(AnytimePlanner(World(world.task)))


class OneOrder(OpenOrders):
    """Agenda of a person who works for any one order until it is served or expires."""

    def __init__(self, world: World, seed: int) -> None:
        super().__init__(world, {})
        self._random = random.Random(f"{seed}:order")
        self._begun: OpenOrder | None = None

    def topic(self, state: State) -> Hashable:
        orders = () if state.orders is None else state.orders.open
        if self._begun not in orders:
            self._begun = self._random.choice(orders) if orders else None
        return self._begun

    def goals(self, state: State) -> Sequence[AnytimePlanner]:
        return () if self._begun is None else (self.planner(self._begun),)


class Pauses(NamedTuple):
    """Pauses of a person: their probability in each step, and their least and greatest length."""

    probability: float
    shortest: int
    longest: int


USUAL, LONG = Pauses(0.05, int(RATE), int(4 * RATE)), Pauses(0.1, int(RATE), int(6 * RATE))


class Newcomer:
    """Cooks with a newcomer's pauses, and makes way two seconds after a request."""

    kind = "human"
    anticipating = False

    def __init__(
        self,
        world: World,
        player: str,
        seed: int,
        *,
        agenda: Agenda | None = None,
        pauses: Pauses = USUAL,
    ) -> None:
        skill = Skill(reaction=0.4, pace=0.6, slips=0.03)
        self._player = player
        self._cook = Cook(world, player, agenda)
        self._policy = SkilledPolicy(self._cook, player, skill, step_seconds=1 / RATE, seed=seed)
        self._random = random.Random(f"{seed}:{player}")
        self._wording = Wording(world, language_of(world.task))
        self._state = world.initial
        self._pauses, self._pause = pauses, 0
        self._asked = -1

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        pass

    def speak(self) -> list[Speech]:
        return []

    def hear(self, player: str, speech: Speech) -> None:
        text = speech.text
        here = standing_at(self._state, self._player)
        if here is not None and requested(text, here, self._state, self._wording):
            self._asked = int(2 * RATE)

    def observe(self, did: Did) -> None:
        self._policy.observe(did)

    def act(self, state: State) -> GroundAction | None:
        self._state = state
        self._asked -= 1
        if self._asked == 0 and not self._cook.is_at_work(state):
            away = walks_out_of_the_way(state, self._player)
            return away[0] if away else None
        self._pause -= 1
        if self._pause > 0:
            return None
        if self._random.random() < self._pauses.probability:
            self._pause = self._random.randint(self._pauses.shortest, self._pauses.longest)
            return None
        return self._policy.act(state)


STOVES, COUNTERS = ("stove", "fryer"), ("hatch",)


def person(kind: str, world: World, player: str, seed: int) -> Policy:
    """Return a simulated person."""
    made: dict[str, Callable[[], Policy]] = {
        "idle": lambda: Idle(player),
        "wandering": lambda: Wanderer(player, seed),
        "hoarding": lambda: Hoarder(player, seed),
        "keeping": lambda: Keeper(player, seed),
        "blocking": lambda: Blocker(player, STOVES, int(60 * RATE)),
        "at_stove": lambda: Blocker(player, STOVES),
        "at_hatch": lambda: Blocker(player, COUNTERS),
        "helpful": lambda: Newcomer(world, player, seed),
        "slow": lambda: Newcomer(world, player, seed, pauses=LONG),
        "stubborn": lambda: Newcomer(world, player, seed, agenda=OneOrder(world, seed)),
    }
    return made[kind]()


PEOPLE = (
    "idle", "wandering", "hoarding", "keeping", "blocking", "at_stove", "helpful",
    "slow", "at_hatch", "stubborn",
)  # fmt: skip
IN_SHIFTS = ("at_hatch", "stubborn")
"""People who only make sense in a shift."""
