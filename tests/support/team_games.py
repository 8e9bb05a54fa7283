"""Episodes in this process whose policies receive the same events as bots on a server."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from robotouille import GroundAction, State, World, load_task
from robotouille.domain.task import Task
from robotouille.episode import (
    TEAM_TOPIC,
    ActionRequest,
    ChatPosted,
    Clock,
    Episode,
    Noted,
    Outcome,
    Phase,
    Rules,
    Stepped,
)
from robotouille.errors import ProtocolError
from robotouille.planning.beam.planner import EXPANSIONS
from robotouille.planning.plan import UNLIMITED, Limits, SearchResult
from robotouille.planning.policies import PlannerOptions, PlannerPolicy, Policy, TeamPolicy
from robotouille.planning.policies.policy import Did, Speech
from robotouille.planning.policies.shift_policy import ShiftPolicy
from robotouille.planning.policies.skill import EXPERT, Skill, SkilledPolicy
from robotouille.planning.policies.team_plan import PART
from robotouille.planning.search.best_first import GREEDY
from robotouille.planning.shift import DishPlanner
from robotouille.planning.solvers import AnytimePlanner

__all__ = ["Idle", "RandomWalker", "TeamGame", "play_team"]

MAX_TRIES = 5


class Idle:
    """Policy that does nothing."""

    kind = "human"

    def __init__(self, player: str) -> None:
        self.player = player

    def observe(self, did: Did) -> None:
        pass

    def act(self, state: State) -> GroundAction | None:
        return None


class RandomWalker(Idle):
    """Policy that walks at random, or with `travel=False` takes any random action."""

    def __init__(self, player: str, seed: int = 5, *, travel: bool = True) -> None:
        super().__init__(player)
        self._random, self._travel = random.Random(f"{seed}:{player}"), travel

    def act(self, state: State) -> GroundAction | None:
        actions = [a for a in state.actions(self.player) if a.destination or not self._travel]
        return self._random.choice(actions) if actions else None


class SharedPlanner(AnytimePlanner):
    """Planner that caches results, because all bots of a team search the same states."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self._answered: dict[tuple[object, ...], list[SearchResult]] = {}

    def search(
        self,
        state: State,
        limits: Limits = UNLIMITED,
        *,
        team: Sequence[str] = (),
        seed: int = 0,
        beam: int = EXPANSIONS,
        choices: int = 1,
        brief: bool = False,
    ) -> Iterator[SearchResult]:
        question = (state, limits, tuple(team), seed, beam, choices, brief)
        if question not in self._answered:
            answers = super().search(
                state, limits, team=team, seed=seed, beam=beam, choices=choices, brief=brief
            )
            self._answered[question] = list(answers)
        return iter(self._answered[question])


class MeteredPlanner(AnytimePlanner):
    """Planner that adds the expansions of its searches to a processor's work."""

    def __init__(self, world: World, processor: Processor) -> None:
        super().__init__(world)
        self._processor = processor

    def analyse(self, state: State, *, choices: int = 1, parts: int) -> int:
        new = super().analyse(state, choices=choices, parts=parts)
        self._processor.work += PART * new
        return new

    def search(
        self,
        state: State,
        limits: Limits = UNLIMITED,
        *,
        team: Sequence[str] = (),
        seed: int = 0,
        beam: int = EXPANSIONS,
        choices: int = 1,
        brief: bool = False,
    ) -> Iterator[SearchResult]:
        before = self.searches
        for found in super().search(
            state, limits, team=team, seed=seed, beam=beam, choices=choices, brief=brief
        ):
            if self.searches > before:
                times = GREEDY_WORK if found.planner == GREEDY else 1
                self._processor.work += times * found.expansions
                before = self.searches
            yield found


class MeteredDish(DishPlanner):
    """Dish whose planner adds its expansions to a processor's work."""

    def __init__(self, world: World, dish: str, processor: Processor) -> None:
        super().__init__(world, dish)
        self._processor = processor

    def new_planner(self) -> AnytimePlanner:
        return MeteredPlanner(self.world, self._processor)


# Measured in the shifts: 375 states of a greedy search take 7 to 50 s, 6,000 expansions of a beam
# search 0.2 to 0.8 s.
GREEDY_WORK = 40
"""Work of an expansion of a search that ends with a greedy search, in expansions of a beam."""


class Processor:
    """Simulated processor that all bots of a game share.

    Args:
        speed: Expansions per step of the game.
    """

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self.work = 0
        self.free_at = 0.0


class Thought(NamedTuple):
    """Steps in which a bot thinks: its player, the first step and their number."""

    player: str
    start: int
    steps: int


class SlowBot:
    """Bot that plans on a slow processor while the game goes on, like the bots of a window."""

    def __init__(self, policy: Policy, player: str, processor: Processor) -> None:
        assert isinstance(policy, TeamPolicy)
        self._policy, self._player, self._processor = policy, player, processor
        self._step = 0
        self._asked = -1
        self._ready = 0.0
        self._action: GroundAction | None = None
        self._unheard: list[Callable[[], None]] = []
        self.anticipating = False
        self.thoughts: list[Thought] = []

    @property
    def _thinks(self) -> bool:
        return self._step < int(self._ready)

    def act(self, state: State) -> GroundAction | None:
        if self._asked < 0:
            before, processor = self._processor.work, self._processor
            self._asked, self._action = self._step, self._policy.act(state)
            start = max(processor.free_at, self._step)
            self._ready = start + (processor.work - before) / processor.speed
            processor.free_at = self._ready
            if self._thinks:
                steps = int(self._ready) - self._step
                self.thoughts.append(Thought(self._player, self._step, steps))
        if self._thinks:
            return None
        asked, self._asked = self._asked, -1
        self.anticipating = self._policy.anticipating and asked == self._step
        self._catch_up()
        late = self._action is not None and not state.world.applicable(state, self._action)
        return None if late else self._action

    def _catch_up(self) -> None:
        unheard, self._unheard = self._unheard, []
        for event in unheard:
            event()

    def _pass_on(self, event: Callable[[], None]) -> None:
        if self._asked < 0:
            event()
        else:
            self._unheard.append(event)

    def observe(self, did: Did) -> None:
        self._step += 1
        self._pass_on(lambda: self._policy.observe(did))

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        self._pass_on(lambda: self._policy.meet(kinds, clock))

    def hear(self, player: str, speech: Speech) -> None:
        self._pass_on(lambda: self._policy.hear(player, speech))

    def speak(self) -> list[Speech]:
        return [] if self._asked >= 0 else self._policy.speak()


@dataclass
class TeamGame:
    """Result of an episode: its outcome, chat messages, and the actions of each step.

    `thoughts` are the steps in which slow bots did nothing because they planned.
    """

    outcome: Outcome | None = None
    said: list[tuple[int, str, str]] = field(default_factory=list)
    steps: list[Did] = field(default_factory=list)
    thoughts: list[Thought] = field(default_factory=list)


def play_team(
    task: str | Task,
    others: Mapping[str, Policy] | None = None,
    *,
    clock: Clock = Clock.LOCKSTEP,
    limit: int = 200,
    alter: Callable[[int, dict[str, Policy]], None] | None = None,
    expansions: int = 2_000,
    skill: Skill = EXPERT,
    step_rate: float = 10,
    seed: int = 0,
    speed: float = math.inf,
) -> TeamGame:
    """Play an episode with planner bots, and with other policies in some seats.

    Args:
        speed: Expansions per step of the game of a processor that all bots share.
        others: Policies by player; their `kind` is `human` if they have one, else `bot`.
        alter: Function called before each step with its number and the policies by player, which
            it may change.
    """
    world = World(load_task(task) if isinstance(task, str) else task)
    episode = Episode(world, Rules(clock=clock, max_steps=limit, step_rate=step_rate))
    processor = Processor(speed)
    bot = _new_bot(world, PlannerOptions(seed=seed, expansions=expansions), processor)
    step_seconds = 1 / step_rate if clock is Clock.REALTIME else 0.0
    if skill != EXPERT:
        skilled = partial(SkilledPolicy, skill=skill, step_seconds=step_seconds, seed=seed)
        plain, bot = bot, lambda player: skilled(plain(player), player)
    if speed < math.inf:
        quick, bot = bot, lambda player: SlowBot(quick(player), player, processor)
    policies: dict[str, Policy] = {
        player: bot(player) for player in world.players if player not in (others or {})
    } | dict(others or {})
    kinds = {p: getattr(policy, "kind", "bot") for p, policy in policies.items()}
    for player in world.players:
        episode.join(player, player, kinds[player], 0.0)
    game, now = TeamGame(), 0.0
    for talker in _talkers(policies):
        talker.meet(kinds, clock.value)
    _deliver(episode, policies, game, now)
    seq = 0
    while episode.phase is Phase.RUNNING:
        if alter is not None:
            alter(episode.step, policies)
        seq, now, state = seq + MAX_TRIES, now + 1 / step_rate, episode.state
        for player in world.players:
            if episode.on_turn not in (None, player) or state.busy_steps(player):
                continue
            if episode.phase is Phase.RUNNING:
                policy = policies[player]
                action = policy.act(episode.state)
                late = isinstance(policy, TeamPolicy) and policy.anticipating
                episode.submit(player, ActionRequest(seq, action, anticipates=late), now)
                _deliver(episode, policies, game, now)
        episode.tick(now)
        _deliver(episode, policies, game, now)
    game.outcome = episode.outcome
    for policy in policies.values():
        if isinstance(policy, SlowBot):
            game.thoughts += policy.thoughts
    return game


def _new_bot(
    world: World, options: PlannerOptions, processor: Processor
) -> Callable[[str], Policy]:
    """Return a function that makes the bot of a seat; all share what they learn of the kitchen."""
    if world.shift is not None:
        dishes: dict[str, DishPlanner] = {
            name: MeteredDish(world, name, processor) for name in world.shift.menu
        }
        return lambda player: ShiftPolicy(
            world, player, options, dishes=dishes, start=world.initial
        )
    is_slow = processor.speed < math.inf
    shared = World(world.task)
    anytime = MeteredPlanner(shared, processor) if is_slow else SharedPlanner(shared)
    return lambda player: PlannerPolicy(
        world, player, options, start=world.initial, anytime=anytime
    )


def _talkers(policies: Mapping[str, Policy]) -> Iterable[TeamPolicy]:
    return [policy for policy in policies.values() if isinstance(policy, TeamPolicy)]


def _deliver(episode: Episode, policies: Mapping[str, Policy], game: TeamGame, now: float) -> None:
    """Deliver all events and chat messages until no policy has anything to say."""
    while True:
        for event in episode.events():
            if isinstance(event, Stepped):
                pairs = zip(event.moves, event.attempts, strict=True)
                did = [(move.player, move.action, attempt.applied) for move, attempt in pairs]
                game.steps.append(did)
                for each in policies.values():
                    each.observe(did)
            elif isinstance(event, ChatPosted):
                game.said.append((episode.step, event.player, event.text))
                for talker in _talkers(policies):
                    talker.hear(event.player, Speech(event.text, event.signal))
            elif isinstance(event, Noted):
                for talker in _talkers(policies):
                    talker.hear(event.player, Speech(event.text, to_bots=True))
        said = [
            (player, speech)
            for player, policy in policies.items()
            if isinstance(policy, TeamPolicy)
            for speech in policy.speak()
        ]
        if not said or episode.ended:
            return
        for player, speech in said:
            _publish(episode, player, speech, now)


def _publish(episode: Episode, player: str, speech: Speech, now: float) -> None:
    if speech.to_bots:
        episode.note(player, TEAM_TOPIC, speech.text, now)
    elif speech.signal is not None:
        with suppress(ProtocolError):
            episode.signal(player, player, speech.signal, now)
    else:
        episode.say(player, player, speech.text, now)
