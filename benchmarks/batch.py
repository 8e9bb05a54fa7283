"""Compare the batch engine with `World.step`: joint steps per second of processor time.

python -m benchmarks.batch

Actions are random valid ones, drawn before timing starts. Masks are computed for all players after
each step. Needs the extra `fast`.
"""

from __future__ import annotations

import argparse
import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from robotouille import GroundAction, State, World, load_task
from robotouille.batch import BatchWorld
from robotouille.compiling import COMPILED

TASKS = {
    "synchronous/01": 5_000_000,
    "asynchronous/06": None,
    "multi_agent/09": 1_000_000,
    "multi_agent/10@4": None,
}
"""Tasks with target rates: joint steps per second, masks included.

They are the smallest task, a soup, a task for two and a task for four."""
COPIES = 1024
STEPS = 100_000


@dataclass(frozen=True)
class Row:
    """Joint steps per second of the world and of the batch, with and without masks."""

    task: str
    world: float
    world_masks: float
    batch: float
    batch_masks: float
    batch_vectors: float


def measure(name: str, steps: int = STEPS, copies: int = COPIES) -> Row:
    """Measure one task."""
    world = World(load_task(name))
    course = joint_walk(world, max(1, steps // 20))

    def masked(state: State) -> list[object]:
        return [state.mask(player) for player in world.players]

    world_rate = rate(lambda: [s.step(joint).goal_reached for s, joint in course], len(course))
    masks_rate = rate(
        lambda: [masked(state.step(joint).state) for state, joint in course], len(course)
    )
    batch = BatchWorld(world, copies, auto_reset=True)
    play(batch, 2)
    rounds = max(1, steps // copies)
    stepping, masking, looking = play(batch, rounds)
    taken = rounds * copies
    return Row(
        name,
        world_rate,
        masks_rate,
        taken / stepping,
        taken / (stepping + masking),
        taken / (stepping + masking + looking),
    )


def joint_walk(world: World, steps: int) -> list[tuple[State, dict[str, GroundAction]]]:
    """Return a random walk in which every player acts in every step."""
    generator = random.Random(9)
    state, course = world.initial, []
    for _ in range(steps):
        valid = {player: state.actions(player) for player in world.players}
        joint = {player: generator.choice(actions) for player, actions in valid.items() if actions}
        course.append((state, joint))
        state = state.step(joint).state
    return course


def rate(work: Callable[[], object], count: int) -> float:
    """Return the best rate of four runs. The first run fills the world's caches."""
    times = []
    for _ in range(4):
        begun = time.process_time()
        work()
        times.append(time.process_time() - begun)
    return count / min(times)


def play(batch: BatchWorld, rounds: int) -> tuple[float, float, float]:
    """Play random actions; return the seconds spent on steps, masks and vectors."""
    spent = [0.0, 0.0, 0.0]
    for _ in range(rounds):
        actions = batch.random_actions()
        times = [time.process_time()]
        batch.step(actions)
        times.append(time.process_time())
        for player in batch.players:
            batch.masks(player)
        times.append(time.process_time())
        batch.vectors()
        times.append(time.process_time())
        for i in range(3):
            spent[i] += times[i + 1] - times[i]
    return spent[0], spent[1], spent[2]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=STEPS, help="joint steps of each task")
    options = parser.parse_args(arguments)
    if not COMPILED:
        print("The batch engine is not compiled: pip install 'robotouille[fast]'")
    print("Joint steps per second of processor time, one core, random valid actions")
    print(f"{'':<18}{'World.step':>12}{'+ masks':>12}{'batch':>14}{'+ masks':>14}{'+ vectors':>14}")
    for name, target in TASKS.items():
        row = measure(name, options.steps)
        cells = "".join(
            f"{figure:>12,.0f} ({figure / base:.0f}×)"
            for figure, base in (
                (row.batch, row.world),
                (row.batch_masks, row.world_masks),
                (row.batch_vectors, row.world_masks),
            )
        )
        aim = "" if target is None else f"  ({row.batch_masks / target:.1f} × target)"
        print(f"{name:<18}{row.world:>12,.0f}{row.world_masks:>12,.0f}{cells}{aim}")


if __name__ == "__main__":
    main()
