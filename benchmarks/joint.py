"""Steps of one player in a world that knows them, and joint steps of a team in one that does not.

A walk that was taken before finds every transition in a table. A team of four meets new
combinations all the time, so what its steps take is working out, and that is another figure.
"""

from __future__ import annotations

import random
import time
from dataclasses import dataclass

from robotouille import World, load_task

__all__ = ["JointRow", "main", "measure"]

TASKS = ("multi_agent/01@4", "multi_agent/07@4", "multi_agent/10@4")
STEPS = 2000
WALKS = 5
"""Other random walks that warm a world."""


@dataclass(frozen=True)
class JointRow:
    """Steps a second of processor time, the listing of valid actions included."""

    task: str
    timing: str
    single: float
    cold: float
    warmed: float
    again: float


def walk(world: World, steps: int, seed: int, *, joint: bool) -> float:
    """A random walk of valid actions: its steps a second."""
    generator = random.Random(seed)
    state, players = world.initial, world.players
    begun = time.process_time()
    for number in range(steps):
        actors = players if joint else (players[number % len(players)],)
        valid = [state.actions(player) for player in actors]
        state = state.step([v[int(generator.random() * len(v))] for v in valid if v]).state
    return steps / (time.process_time() - begun)


def measure(task: str, timing: str) -> JointRow:
    """All figures of one task: the joint walk in a new world, after others, and once more."""
    loaded = load_task(task, timing=timing)
    world = World(loaded)
    walk(world, STEPS, 0, joint=False)
    single = max(walk(world, STEPS, 0, joint=False) for _ in range(3))
    world = World(loaded)
    cold = walk(world, STEPS, 0, joint=True)
    for seed in range(1, WALKS + 1):
        walk(world, STEPS, seed, joint=True)
    warmed = walk(world, STEPS, WALKS + 1, joint=True)
    again = walk(world, STEPS, WALKS + 1, joint=True)
    return JointRow(task, timing, single, cold, warmed, again)


def main() -> list[JointRow]:
    rows = [measure(task, timing) for task in TASKS for timing in ("benchmark", "people")]
    print("Steps a second, valid actions listed and chosen at random")
    print(f"{'':30}{'one player,':>14}{'four,':>10}{'four,':>12}{'four,':>14}")
    print(f"{'':30}{'known walk':>14}{'cold':>10}{'new walk':>12}{'known walk':>14}")
    for row in rows:
        figures = f"{row.single:14,.0f}{row.cold:10,.0f}{row.warmed:12,.0f}{row.again:14,.0f}"
        print(f"{row.task + ', ' + row.timing:30}{figures}")
    return rows


if __name__ == "__main__":
    main()
