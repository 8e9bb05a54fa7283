"""The command `robotouille-train`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from robotouille import RobotouilleError, World
from robotouille.files.writing import check_folder
from robotouille_jax.learning.network import Networks
from robotouille_jax.learning.ppo import Config, Curve, trainer
from robotouille_jax.learning.results import Training, draw_results, write_results
from robotouille_jax.learning.starts import FIRST, PLAN, start_states
from robotouille_jax.learning.team_environment import TeamEnvironment

ALGORITHMS = ("ippo", "mappo")


def main(arguments: Sequence[str] | None = None) -> int:
    """Train a team with IPPO, MAPPO or both; write weights, learning curves and a picture."""
    asked = _parser().parse_args(arguments)
    try:
        check_folder(asked.out)
        config = Config(**{field.name: getattr(asked, field.name) for field in fields(Config)})
        training = _training(asked, config)
        networks, curve = train(training, asked.seconds)
        table = write_results(training, networks, curve, asked.out)
        if not asked.no_picture:
            draw_results(table)
        print(f"{training.task}: results written to {asked.out}")
        if len(training.world.players) > 1:
            print(f"to evaluate them: robotouille cross-play {training.task} {asked.out}/*.npz")
    except RobotouilleError as error:
        print(f"robotouille-train: {error}", file=sys.stderr)
        return 2
    return 0


def train(training: Training, seconds: float | None = None) -> tuple[Networks, Curve]:
    """Train all runs side by side.

    Args:
        seconds: Time for which fewer rollouts are taken, if all of them would need more.

    Returns:
        The networks and the curves of all runs.
    """
    task, config = training.task, training.config
    runs = len(training.algorithms) * training.seeds
    keys = jax.vmap(jax.random.key)(jnp.arange(runs) % training.seeds)
    central = jnp.array([name == "mappo" for name in training.algorithms]).repeat(training.seeds)
    device = jax.devices()[0]
    print(f"{task}: compiling for {device}, which can take minutes", flush=True)
    began = time.perf_counter()
    vmapped = jax.jit(jax.vmap(trainer(training.environment, config), in_axes=(0, 0, None)))
    compiled = vmapped.lower(keys, central, jnp.int32(0)).compile()
    print(f"{task}: {device}, compiled in {time.perf_counter() - began:.1f} s", flush=True)

    def run(updates: int) -> tuple[Any, float]:
        began = time.perf_counter()
        found = jax.block_until_ready(compiled(keys, central, jnp.int32(updates)))
        return found, time.perf_counter() - began

    updates = config.updates if seconds is None else _affordable(run, config.updates, seconds)
    (networks, curve), took = run(updates)
    steps = config.copies * config.rollout * updates
    print(
        f"{task}: {runs} runs of {steps} joint steps in {took:.1f} s, "
        f"{runs * steps / took:.0f} steps/s"
    )
    return networks, Curve(*(np.asarray(values[:, :updates], np.float64) for values in curve))


def _affordable(run: Callable[[int], tuple[Any, float]], most: int, seconds: float) -> int:
    """Return the number of rollouts that fit into a time, after a trial of three."""
    each = run(3)[1] / 3
    updates = max(1, min(most, int(seconds / each)))
    print(f"{each:.3f} s for a rollout of all runs; taking {updates}")
    return updates


def _training(asked: argparse.Namespace, config: Config) -> Training:
    algorithms = _algorithms(asked.algorithms)
    world = World(asked.task)
    horizon = asked.horizon if world.shift is None else world.shift.steps
    environment = TeamEnvironment(
        world, horizon, config.gamma, asked.shaping, start_states(world, asked.starts)
    )
    return Training(asked.task, world, environment, config, algorithms, asked.seeds)


def _algorithms(text: str) -> list[str]:
    found = [name.strip() for name in text.split(",")]
    wrong = [name for name in found if name not in ALGORITHMS]
    if wrong:
        raise RobotouilleError(
            f"--algorithms: unknown algorithm {wrong[0]!r} (possible: {', '.join(ALGORITHMS)})"
        )
    return found


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"expected at least 1, found {text}")
    return number


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("robotouille-train", description=main.__doc__)
    parser.add_argument("task", help="a task with its seats, as in training/03@2")
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")

    def option(name: str, default: Any, help: str, **how: Any) -> None:
        parser.add_argument(name, default=default, help=f"{help} (default: {default})", **how)

    option("--algorithms", "ippo,mappo", "ippo, mappo or both")
    option("--seeds", 5, "runs of each algorithm", type=_positive)
    option("--horizon", 50, "longest episode; a shift has its own length", type=_positive)
    option("--shaping", 1.0, "weight of the shaped reward; 0 leaves the sparse one", type=float)
    option(
        "--starts", FIRST, "first: episodes start in the task's first state; plan: in all states "
        "along its certified plan (in a shift, of a game of planner bots), and later in the first",
        choices=(FIRST, PLAN),
    )  # fmt: skip
    for field in fields(Config):
        how = field.metadata["help"]
        option(f"--{field.name}", field.default, how, type=type(field.default))
    time_limit = "longest time for training, without compiling; reduces --updates to keep it"
    parser.add_argument("--seconds", type=float, help=time_limit)
    parser.add_argument("--no-picture", action="store_true", help="draw no learning curves")
    return parser


if __name__ == "__main__":
    sys.exit(main())
