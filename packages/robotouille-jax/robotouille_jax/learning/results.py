"""Files of finished runs: weights, the table of the curves, and a picture of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np

from robotouille import World
from robotouille_jax.learning.curves import Numbers, RunCurves, draw, write_curves
from robotouille_jax.learning.network import Networks
from robotouille_jax.learning.ppo import Config, Curve
from robotouille_jax.learning.team_environment import TeamEnvironment
from robotouille_jax.learning.weights import write_weights

LAST = 10
"""Rollouts at the end of a run whose means are printed."""


@dataclass(frozen=True)
class Training:
    """Runs on a task: all seeds of one algorithm, then those of the next.

    Attributes:
        task: The task as the user named it.
        seeds: Number of runs of each algorithm.
    """

    task: str
    world: World
    environment: TeamEnvironment
    config: Config
    algorithms: list[str]
    seeds: int

    @property
    def stem(self) -> str:
        """Beginning of the names of all files."""
        parts = self.world.task.name.split("/")
        return f"{parts[0]}_{parts[-1][:2]}"

    @property
    def measures(self) -> tuple[str, ...]:
        """The curves that mean something for the task."""
        return ("goals", "steps", "progress") if self.world.shift is None else ("score",)


def write_results(training: Training, networks: Networks, curve: Curve, out: Path) -> Path:
    """Write the weights of all runs and the table of their curves; print the last results.

    Returns:
        The table.
    """
    out.mkdir(parents=True, exist_ok=True)
    _write_networks(training, networks, out)
    points = np.arange(1.0, len(curve.goals[0]) + 1)
    points *= training.config.copies * training.config.rollout
    all_curves, missing = [], False
    for i, algorithm in enumerate(training.algorithms):
        own = slice(i * training.seeds, (i + 1) * training.seeds)
        parts = {name: getattr(curve, name)[own] for name in training.measures}
        all_curves.append(RunCurves(training.task, algorithm.upper(), points, parts))
        for name, values in parts.items():
            last = _last(values)
            missing = missing or bool(np.isnan(last).any())
            words = " ".join("-" if np.isnan(number) else f"{number:.3f}" for number in last)
            title = f"{algorithm} last {LAST} rollouts, {name} of each seed"
            print(f"{training.task}: {title}: {words}")
    if missing:
        print(
            f"-: in these rollouts of {training.config.rollout} steps, no episode from the task's "
            "first state ended or, for steps, reached the goal: train with more --updates. "
            "Progress is measured with a --shaping above 0 only"
        )
    table = out / f"{training.stem}_curves.csv"
    write_curves(table, all_curves)
    return table


def draw_results(table: Path) -> None:
    """Draw a table next to it."""
    draw(table.with_suffix(".png"), [table])


def _write_networks(training: Training, networks: Networks, out: Path) -> None:
    names = [f"{a}_{seed}" for a in training.algorithms for seed in range(training.seeds)]
    for run, name in enumerate(names):
        actor = jax.tree.map(lambda x, run=run: x[run], networks.actor)
        path = out / f"{training.stem}_{name}.npz"
        write_weights(path, training.world, training.environment.views, actor, path.stem)


def _last(values: Numbers) -> list[float]:
    # No episode may have ended, or none at the goal.
    ends = (run[~np.isnan(run)] for run in values[:, -LAST:])
    return [float(run.mean()) if len(run) else np.nan for run in ends]
