"""Make the film at the top of README: planners serve orders in simulated time.

    python tools/make_film.py                  write docs/images/kitchen.gif
    python tools/make_film.py OUT.gif          write another file

The episode is recorded like on a server, and `robotouille replay video` would make the same film.
No clock is read and all randomness is seeded, so the film is always the same.
"""

from __future__ import annotations

import argparse
import os
import random
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

from robotouille import World, load_task
from robotouille.episode import ActionRequest, Clock, Episode, Rules, Stepped
from robotouille.planning.policies import PlannerOptions, PlannerPolicy
from robotouille.planning.policies.shift_policy import ShiftPolicy
from robotouille.planning.shift import DishPlanner
from robotouille.planning.solvers import AnytimePlanner
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import recording_of
from robotouille_client.window.replay.film import film
from robotouille_client.window.replay.histories.recorded_history import RecordedHistory

FILM = Path(__file__).resolve().parents[1] / "docs" / "images" / "kitchen.gif"
TASK, SEED = "shifts/06_rush_hour@3", 3
NAMES = ("Ada", "Björn", "Chen", "Dara")
STEP_RATE, MAX_STEPS = 5.0, 600
HASTE = 0.9
"""Probability that a player acts in a step, since people hesitate."""
SPEED, SIZE = 4.0, "800x500"
"""Steps a second in the film, and its size in pixels."""
SPAN = (476, 554)
"""Steps of the shift that the film shows, in 20 seconds."""


def record(task: str = TASK) -> bytes:
    """Play an episode and return its recording."""
    world = World(load_task(task, timing="people"))
    dice = random.Random(SEED)
    rules = Rules(clock=Clock.REALTIME, step_rate=STEP_RATE, max_steps=MAX_STEPS)
    episode, recorder = Episode(world, rules), Recorder(world, wall=lambda: 0.0)
    created = "2026-01-01T12:00:00Z"
    head = header(world.task, rules, episode="film", seed=SEED, created=created)
    stream = recorder.begin(head)
    bots = _bots(world)
    for player, name in zip(world.players, NAMES, strict=False):
        episode.join(player, name, "bot", 0.0)
        bots[player].meet(dict.fromkeys(bots, "bot"), rules.clock.value)
    now, period, numbers = 0.0, 1 / STEP_RATE, dict.fromkeys(bots, 0)
    while episode.outcome is None:
        for player, bot in bots.items():
            if not episode.state.busy_steps(player) and dice.random() < HASTE:
                numbers[player] += 1
                episode.submit(
                    player, ActionRequest(numbers[player], bot.act(episode.state)), now + period / 2
                )
        now += period
        episode.tick(now)
        events = list(episode.events())
        stream += recorder.record(events)
        for event in events:
            if isinstance(event, Stepped):
                pairs = zip(event.moves, event.attempts, strict=True)
                did = [(move.player, move.action, attempt.applied) for move, attempt in pairs]
                for bot in bots.values():
                    bot.observe(did)
    return stream


def _bots(world: World) -> dict[str, PlannerPolicy] | dict[str, ShiftPolicy]:
    options = PlannerOptions(seed=SEED)
    if world.shift is not None:
        dishes: dict[str, DishPlanner] = {}
        return {p: ShiftPolicy(world, p, options, dishes=dishes) for p in world.players}
    planner = AnytimePlanner(world)
    return {p: PlannerPolicy(world, p, options, anytime=planner) for p in world.players}


def main(arguments: Sequence[str] | None = None) -> None:
    """Play the episode and write the film."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("output", type=Path, nargs="?", default=FILM, metavar="OUT.gif")
    output = parser.parse_args(arguments).output
    history = RecordedHistory(recording_of(record(), "film"))
    frames = film(history, output, SPEED, SIZE, SPAN)
    print(f"{output}: {history.length} steps, {frames} frames, {output.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
