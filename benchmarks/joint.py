"""Measure cached steps of one player and mostly uncached joint steps of a team.

A repeated walk finds every transition in a table. A team of four meets new combinations all the
time, so its steps must be computed, and both rates are reported.
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
"""Number of random walks that fill the world's caches."""


@dataclass(frozen=True)
class JointRow:
    """Steps per second of processor time, including the listing of valid actions."""

    task: str
    timing: str
    single: float
    cold: float
    warmed: float
    again: float


def walk(world: World, steps: int, seed: int, *, joint: bool) -> float:
    """Play a random walk of valid actions and return its steps per second."""
    generator = random.Random(seed)
    state, players = world.initial, world.players
    begun = time.process_time()
    for number in range(steps):
        actors = players if joint else (players[number % len(players)],)
        valid = [state.actions(player) for player in actors]
        state = state.step([v[int(generator.random() * len(v))] for v in valid if v]).state
    return steps / (time.process_time() - begun)


def measure(task: str, timing: str) -> JointRow:
    """Measure one task: a joint walk in a new world, after other walks, and repeated."""
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
    print("Steps per second, with random choice among the listed valid actions")
    print(f"{'':30}{'one player,':>14}{'four,':>10}{'four,':>12}{'four,':>14}")
    print(f"{'':30}{'known walk':>14}{'cold':>10}{'new walk':>12}{'known walk':>14}")
    for row in rows:
        figures = f"{row.single:14,.0f}{row.cold:10,.0f}{row.warmed:12,.0f}{row.again:14,.0f}"
        print(f"{row.task + ', ' + row.timing:30}{figures}")
    return rows


if __name__ == "__main__":
    main()
