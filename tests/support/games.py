"""Complete episodes played in this process, for tests that need recordings or messages."""

from __future__ import annotations

import random
from collections.abc import Callable

from robotouille import GroundAction, World, load_task
from robotouille.episode import ActionRequest, Clock, Episode, Event, Phase, Reason, Rules
from robotouille.replay.recorder import Recorder, header

TWO = World("multi_agent/01")
"""Kitchen for two players."""

Choose = Callable[[Episode, str], GroundAction | None]


def random_choice(seed: int) -> Choose:
    """Return a policy that picks random valid actions and sometimes does nothing."""
    generator = random.Random(seed)

    def choose(episode: Episode, player: str) -> GroundAction | None:
        actions = episode.state.actions(player)
        if not actions or generator.random() < 0.05:
            return None
        return generator.choice(actions)

    return choose


def play_through(
    task: str, rules: Rules, choose: Choose, *, timing: str = "benchmark"
) -> tuple[Episode, list[Event]]:
    """Play an episode to its end with all seats taken; each round takes 0.1 s."""
    world = World(load_task(task, timing=timing))
    episode = Episode(world, rules)
    for player in world.players:
        episode.join(player, f"{player}-bot", "bot", 0.0)
    events = episode.events()
    now, seq = 0.0, 0
    while episode.phase is Phase.RUNNING:
        now += 0.1
        seq += 1
        for player in world.players:
            mine = episode.on_turn in (None, player) and not episode.state.busy_steps(player)
            if episode.phase is Phase.RUNNING and mine:
                request = ActionRequest(seq, choose(episode, player), anticipates=True)
                episode.submit(player, request, now)
        episode.tick(now)
        events += episode.events()
    return episode, events


def record(episode: Episode, events: list[Event]) -> bytes:
    """Return the bytes of an episode's recording."""
    head = header(episode.world.task, episode.rules, episode="test")
    recorder = Recorder(episode.world)
    return recorder.begin(head) + recorder.record(events)


def recorded_game(
    task: str,
    *,
    seed: int = 0,
    clock: Clock = Clock.LOCKSTEP,
    steps: int = 120,
    **options: str,
) -> bytes:
    """Return the recording of a random episode."""
    rules = Rules(clock=clock, max_steps=steps)
    return record(*play_through(task, rules, random_choice(seed), **options))


def outcome(episode: Episode) -> tuple[Reason, str]:
    """Return why an episode ended, with the detail."""
    assert episode.outcome is not None
    return episode.outcome.reason, episode.outcome.detail
