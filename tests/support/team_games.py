"""Episodes in this process whose policies receive the same events as bots on a server."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial

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


@dataclass
class TeamGame:
    """Result of an episode: its outcome, chat messages, and the actions of each step."""

    outcome: Outcome | None = None
    said: list[tuple[int, str, str]] = field(default_factory=list)
    steps: list[Did] = field(default_factory=list)


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
) -> TeamGame:
    """Play an episode with planner bots, and with other policies in some seats.

    Args:
        others: Policies by player; their `kind` is `human` if they have one, else `bot`.
        alter: Function called before each step with its number and the policies by player, which
            it may change.
    """
    world = World(load_task(task) if isinstance(task, str) else task)
    episode = Episode(world, Rules(clock=clock, max_steps=limit, step_rate=step_rate))
    bot = _new_bot(world, PlannerOptions(seed=seed, expansions=expansions))
    step_seconds = 1 / step_rate if clock is Clock.REALTIME else 0.0
    if skill != EXPERT:
        skilled = partial(SkilledPolicy, skill=skill, step_seconds=step_seconds, seed=seed)
        plain, bot = bot, lambda player: skilled(plain(player), player)
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
    return game


def _new_bot(world: World, options: PlannerOptions) -> Callable[[str], Policy]:
    """Return a function that makes the bot of a seat; all share what they learn of the kitchen."""
    if world.shift is not None:
        dishes: dict[str, DishPlanner] = {}
        return lambda player: ShiftPolicy(
            world, player, options, dishes=dishes, start=world.initial
        )
    anytime = SharedPlanner(World(world.task))
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
