"""Measure the learning environments: steps per second with masks and observations.

Each environment plays three random walks: one in a new world with empty caches, a new walk after
five others, and a repeated walk. Training lies between the last two. The time to choose actions is
not counted. `reset` with a new instance is measured too.
"""

from __future__ import annotations

import gc
import pickle
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import MultiDiscrete

from robotouille import World
from robotouille.compiling import COMPILED
from robotouille.envs import RobotouilleEnv, RobotouilleVectorEnv, parallel_env

__all__ = ["EnvironmentRow", "ResetRow", "main", "measure", "measure_resets"]

STEPS = 4000
COPIES = 64
RESETS = 200
RESET_TASKS = ("synchronous/01", "asynchronous/10", "multi_agent/01@2", "multi_agent/10@4")

AIMS = {
    ("gymnasium", "synchronous/01"): 150_000,
    ("gymnasium", "asynchronous/10"): 40_000,
    ("pettingzoo", "multi_agent/01"): 60_000,
    ("pettingzoo", "multi_agent/10@4"): 20_000,
    ("vector", "synchronous/01"): 0,
    ("vector", "multi_agent/10@4"): 0,
}
"""Target rates; 0 means no target."""
OVERCOOKED = 24_000
"""Steps per second of Overcooked-AI's environment on one core of the target machine, measured
separately."""


@dataclass(frozen=True)
class EnvironmentRow:
    """Steps per second of processor time; joint steps for several players."""

    interface: str
    task: str
    cold: float
    warmed: float
    again: float


def chosen(mask: Any, random: np.random.Generator) -> int:
    numbers = np.flatnonzero(mask)
    return int(numbers[int(random.random() * len(numbers))]) if len(numbers) else 0


def choose(env: Any, info: Any, random: np.random.Generator) -> Any:
    """Choose random valid actions in the form that the environment expects."""
    if isinstance(env, RobotouilleVectorEnv):
        space = env.single_action_space
        ends: Any = np.cumsum(space.nvec)[:-1] if isinstance(space, MultiDiscrete) else ()
        parts = [part for mask in info["action_mask"] for part in np.split(mask, ends)]
        return np.array([chosen(part, random) for part in parts]).reshape(env.action_space.shape)
    if isinstance(env, RobotouilleEnv):
        return chosen(info["action_mask"], random)
    return {agent: chosen(info[agent]["action_mask"], random) for agent in env.agents}


def over(env: Any, result: tuple[Any, ...]) -> bool:
    """Return whether the environment needs a reset."""
    if isinstance(env, RobotouilleVectorEnv):
        return False
    return bool(result[2] or result[3]) if isinstance(env, RobotouilleEnv) else not env.agents


def course(env: Any, steps: int, seed: int) -> list[Any]:
    """Return the actions of a random walk, with None where the environment is reset."""
    random = np.random.default_rng(seed)
    _, info = env.reset(seed=seed)
    taken: list[Any] = []
    for _ in range(steps):
        taken.append(choose(env, info, random))
        result = env.step(taken[-1])
        info = result[-1]
        if over(env, result):
            taken.append(None)
            _, info = env.reset()
    return taken


def timed(env: Any, taken: list[Any]) -> float:
    """Return the steps per second of replaying a walk."""
    env.reset(seed=0)
    begun = time.process_time()
    for action in taken:
        if action is None:
            env.reset()
        else:
            env.step(action)
    steps = sum(action is not None for action in taken)
    return steps / (time.process_time() - begun)


def measure(interface: str, task: str) -> EnvironmentRow:
    """Measure one environment."""
    copies = COPIES if interface == "vector" else 1
    makers: dict[str, Callable[[], Any]] = {
        "gymnasium": lambda: RobotouilleEnv(task),
        "pettingzoo": lambda: parallel_env(task),
        "vector": lambda: RobotouilleVectorEnv(task, copies),
    }
    make, steps = makers[interface], max(10, STEPS // copies)
    env = make()
    first, new = course(env, steps, 0), course(env, steps, 9)
    del env
    gc.collect()  # Frees the world of those environments with its caches.
    env = make()
    cold = timed(env, first)
    for seed in range(1, 5):
        course(env, steps, seed)
    warmed = timed(env, new)
    again = max(timed(env, new) for _ in range(3))
    return EnvironmentRow(interface, task, cold * copies, warmed * copies, again * copies)


@dataclass(frozen=True)
class ResetRow:
    """Milliseconds of processor time for `reset` with a new instance, and seconds to make one."""

    task: str
    made: float
    median: float
    worst: float


def measure_resets(task: str, count: int = RESETS) -> ResetRow:
    """Measure how long an environment with endless instances takes to begin an episode."""
    begun = time.process_time()
    env = parallel_env(task, instances="endless")
    made = time.process_time() - begun
    env.reset(seed=0, options={"instance": 0})  # The first one also fills the world's caches.
    first = time.process_time() - begun - made
    times = [first]
    for _ in range(count):
        begun = time.process_time()
        env.reset()
        times.append(time.process_time() - begun)
    return ResetRow(task, made, 1000 * statistics.median(times), 1000 * max(times))


def print_resets() -> None:
    print(f"New instances: `reset` of PettingZoo environments ({RESETS} resets)")
    print(f"{'':32}{'make':>12}{'median':>12}{'worst':>12}{'target':>18}")
    for task in RESET_TASKS:
        row = measure_resets(task)
        figures = f"{row.made:10.1f} s{row.median:9.1f} ms{row.worst:9.1f} ms"
        print(f"{task:32}{figures}{'20 ms, 200 ms':>18}")


def main() -> list[EnvironmentRow]:
    rows = [measure(interface, task) for interface, task in AIMS]
    engine = "batch engine is" if COMPILED else "batch engine is not"
    print(f"Environments: steps per second with masks and vectors ({engine} compiled)")
    print(f"{'':32}{'new world':>12}{'new walk':>12}{'known walk':>12}{'target':>12}")
    for row in rows:
        aim = AIMS[row.interface, row.task]
        figures = f"{row.cold:12,.0f}{row.warmed:12,.0f}{row.again:12,.0f}"
        print(f"{row.interface + ', ' + row.task:32}{figures}{f'{aim:,}' if aim else '':>12}")
    print(f"{'Overcooked-AI (not measured)':32}{'':36}{OVERCOOKED:>12,}")
    print_resets()
    world = World("multi_agent/10@4")
    state = world.initial
    packed, pickled = len(world.pack(state)), len(pickle.dumps(state))
    print(f"A state of multi_agent/10@4: {packed} bytes packed, {pickled} pickled")
    return rows


if __name__ == "__main__":
    main()
