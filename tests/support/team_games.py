"""Games in this process whose seats are told what bots are told over the network, in its order."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from robotouille import GroundAction, State, World, load_task
from robotouille.domain.task import Task
from robotouille.episode import Clock, Episode, Outcome, Phase, RosterChanged, Rules, Said, Stepped
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.beam.planner import EXPANSIONS
from robotouille.planning.policies import PlannerPolicy, Policy, TeamPolicy
from robotouille.planning.policies.script import Did
from robotouille.planning.search_result import UNLIMITED, Limits, SearchResult

__all__ = ["Chance", "Idle", "TeamGame", "play_team"]

MAX_TRIES = 5


class Idle:
    """Stands where it stands, and does nothing."""

    kind = "human"

    def __init__(self, player: str) -> None:
        self.player = player

    def observe(self, did: Did) -> None:
        pass

    def act(self, state: State) -> GroundAction | None:
        return None


class Chance(Idle):
    """Walks here and there, or with `travel=False` does anything."""

    def __init__(self, player: str, seed: int = 5, *, travel: bool = True) -> None:
        super().__init__(player)
        self._random, self._travel = random.Random(f"{seed}:{player}"), travel

    def act(self, state: State) -> GroundAction | None:
        actions = [a for a in state.actions(self.player) if a.destination or not self._travel]
        return self._random.choice(actions) if actions else None


class SharedPlanner(AnytimePlanner):
    """Answers each question once: all bots of a team ask the same."""

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
    """How a game went: its outcome, what was said by whom, and the actions of each step."""

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
) -> TeamGame:
    """A game of planner bots, with other policies in some seats.

    Args:
        others: By player; their `kind` is `human` if they have one, else `bot`.
        alter: Is called before each step with its number and the policies by player, and may
            change them.
    """
    world = World(load_task(task) if isinstance(task, str) else task)
    episode = Episode(world, Rules(clock=clock, max_steps=limit, step_rate=10))
    anytime = SharedPlanner(World(world.task))
    policies: dict[str, Policy] = {
        player: PlannerPolicy(
            world, player, start=world.initial, expansions=expansions, anytime=anytime
        )
        for player in world.players
        if player not in (others or {})
    } | dict(others or {})
    kinds = {p: getattr(policy, "kind", "bot") for p, policy in policies.items()}
    for player in world.players:
        episode.join(player, player, kinds[player], 0.0)
    game, now = TeamGame(), 0.0
    for talker in _talkers(policies):
        talker.meet(kinds, clock.value)
    _hear(episode, policies, game, now)
    seq = 0
    while episode.phase is Phase.RUNNING:
        if alter is not None:
            alter(episode.step, policies)
        seq, now, state = seq + MAX_TRIES, now + 0.1, episode.state
        for player in world.players:
            if episode.on_turn not in (None, player) or state.busy_steps(player):
                continue
            if episode.phase is Phase.RUNNING:
                policy = policies[player]
                action = policy.act(episode.state)
                late = isinstance(policy, TeamPolicy) and policy.anticipating
                episode.submit(player, seq, action, now, anticipates=late)
                _hear(episode, policies, game, now)
        episode.tick(now)
        _hear(episode, policies, game, now)
    game.outcome = episode.outcome
    return game


def _talkers(policies: Mapping[str, Policy]) -> Iterable[TeamPolicy]:
    return [policy for policy in policies.values() if isinstance(policy, TeamPolicy)]


def _hear(episode: Episode, policies: Mapping[str, Policy], game: TeamGame, now: float) -> None:
    """Tell everybody what has happened, until nobody has anything to say."""
    while True:
        for event in episode.events():
            if isinstance(event, Stepped):
                pairs = zip(event.moves, event.attempts, strict=True)
                did = [(move.player, move.action, attempt.applied) for move, attempt in pairs]
                game.steps.append(did)
                for each in policies.values():
                    each.observe(did)
            elif isinstance(event, Said):
                game.said.append((episode.step, event.player, event.text))
                for talker in _talkers(policies):
                    talker.hear(event.player, event.text)
            elif isinstance(event, RosterChanged):
                pass
        said = [
            (player, text)
            for player, policy in policies.items()
            if isinstance(policy, TeamPolicy)
            for text in policy.speak()
        ]
        if not said or episode.ended:
            return
        for player, text in said:
            episode.say(player, player, text, now)
