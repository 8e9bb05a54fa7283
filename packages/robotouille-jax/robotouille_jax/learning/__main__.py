"""The command `robotouille-train`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from robotouille import RobotouilleError, World
from robotouille_jax.learning.curves import RunCurves, draw, write_curves
from robotouille_jax.learning.network import Networks
from robotouille_jax.learning.ppo import Config, Curve, trainer
from robotouille_jax.learning.team_environment import TeamEnvironment
from robotouille_jax.learning.weights import write_weights

ALGORITHMS = ("ippo", "mappo")


def main(arguments: Sequence[str] | None = None) -> int:
    """Train runs of both algorithms side by side; write curves, weights and a picture."""
    asked = _parser().parse_args(arguments)
    try:
        train(asked, Config(**{field.name: getattr(asked, field.name) for field in fields(Config)}))
    except RobotouilleError as error:
        print(f"robotouille-train: {error}", file=sys.stderr)
        return 2
    return 0


def train(asked: argparse.Namespace, config: Config) -> None:
    """Train on a task and write the results into the folder `asked.out`."""
    world = World(asked.task)
    horizon = asked.horizon if world.shift is None else world.shift.steps
    environment = TeamEnvironment(world, horizon, config.gamma, asked.shaping)
    algorithms = _algorithms(asked.algorithms)
    runs = len(algorithms) * asked.seeds
    keys = jax.vmap(jax.random.key)(jnp.arange(runs) % asked.seeds)
    central = jnp.array([name == "mappo" for name in algorithms for _ in range(asked.seeds)])
    device = jax.devices()[0]
    print(f"{asked.task}: compiling for {device}, which can take minutes", flush=True)
    began = time.perf_counter()
    vmapped = jax.jit(jax.vmap(trainer(environment, config), in_axes=(0, 0, None)))
    run = vmapped.lower(keys, central, jnp.int32(0)).compile()
    print(f"{asked.task}: {device}, compiled in {time.perf_counter() - began:.1f} s")
    updates = config.updates
    if asked.seconds:
        began = time.perf_counter()
        jax.block_until_ready(run(keys, central, jnp.int32(3)))
        each = (time.perf_counter() - began) / 3
        updates = max(1, min(updates, int(asked.seconds / each)))
        print(f"{asked.task}: {each:.3f} s for a rollout of all runs; taking {updates}")
    began = time.perf_counter()
    networks, curve = jax.block_until_ready(run(keys, central, jnp.int32(updates)))
    seconds = time.perf_counter() - began
    steps = config.copies * config.rollout * updates
    print(
        f"{asked.task}: {runs} runs of {steps} joint steps in {seconds:.1f} s, "
        f"{runs * steps / seconds:.0f} steps/s"
    )
    _write(asked, world, environment, config, networks, _first(curve, updates), algorithms)


def _algorithms(text: str) -> list[str]:
    found = [name.strip() for name in text.split(",")]
    wrong = [name for name in found if name not in ALGORITHMS]
    if wrong:
        raise RobotouilleError(
            f"--algorithms: unknown algorithm {wrong[0]!r} (possible: {', '.join(ALGORITHMS)})"
        )
    return found


def _first(curve: Curve, updates: int) -> Curve:
    return Curve(*(np.asarray(values[:, :updates], np.float64) for values in curve))


def _write(
    asked: argparse.Namespace, world: World, environment: TeamEnvironment, config: Config,
    networks: Networks, curve: Curve, algorithms: Sequence[str],
) -> None:  # fmt: skip
    asked.out.mkdir(parents=True, exist_ok=True)
    stem = world.task.name.split("/")[0][:8] + "_" + world.task.name.split("/")[-1][:2]
    measures = curve._asdict()
    for name in ("goals", "steps", "progress") if world.shift is not None else ("score",):
        del measures[name]
    points = np.arange(1.0, len(curve.goals[0]) + 1) * config.copies * config.rollout
    all_curves = []
    for i, algorithm in enumerate(algorithms):
        own = slice(i * asked.seeds, (i + 1) * asked.seeds)
        parts = {name: values[own] for name, values in measures.items()}
        all_curves.append(RunCurves(asked.task, algorithm.upper(), points, parts))
        for seed in range(asked.seeds):
            actor = jax.tree.map(lambda x, run=own.start + seed: x[run], networks.actor)
            name = f"{stem}_{algorithm}_{seed}"
            write_weights(asked.out / f"{name}.npz", world, environment.views, actor, name)
        for name, values in parts.items():
            # No episode may have ended, or none at the goal.
            ends = (run[~np.isnan(run)] for run in values[:, -10:])
            last = [run.mean() if len(run) else np.nan for run in ends]
            print(f"{asked.task}: {algorithm} last 10 rollouts, {name}: {np.round(last, 3)}")
    table = asked.out / f"{stem}_curves.csv"
    write_curves(table, all_curves)
    if not asked.no_picture:
        draw(asked.out / f"{stem}_curves.png", [table])


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"expected at least 1, found {text}")
    return number


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("robotouille-train", description=main.__doc__)
    parser.add_argument("task", help="a task with its seats, as in training/03@2")
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    parser.add_argument("--algorithms", default="ippo,mappo", help="ippo, mappo or both")
    parser.add_argument("--seeds", type=_positive, default=5, help="runs of each algorithm")
    parser.add_argument("--horizon", type=_positive, default=50, help="longest episode")
    parser.add_argument("--shaping", type=float, default=1.0, help="weight of the shaped reward")
    parser.add_argument("--seconds", type=float, help="take fewer rollouts to need at most this")
    parser.add_argument("--no-picture", action="store_true", help="do without Matplotlib")
    for field in fields(Config):
        parser.add_argument(f"--{field.name}", type=type(field.default), default=field.default)
    return parser


if __name__ == "__main__":
    sys.exit(main())
