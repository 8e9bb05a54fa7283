"""Trained actors as files of arrays, which play with NumPy alone (`TrainedPolicy`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from robotouille.world.world import World
from robotouille_jax.learning.network import Layers
from robotouille_jax.learning.team_environment import TeamEnvironment

VERSION = 1


def write_weights(
    path: Path, world: World, environment: TeamEnvironment, actor: Layers, name: str
) -> None:
    """Write an actor; 16-bit numbers halve the file and change no choice that matters."""
    layers: dict[str, Any] = {
        f"{kind}{i}": np.asarray(array, np.float16)
        for i, layer in enumerate(actor)
        for kind, array in zip(("weights", "biases"), layer, strict=True)
    }
    np.savez_compressed(
        path,
        version=np.int64(VERSION),
        name=np.str_(name),
        task=np.str_(world.task.name),
        digest=np.str_(world.task.digest),
        encoding=np.int64(world.encoding.version),
        columns=environment.views.columns,
        scale=environment.views.scale,
        **layers,
    )
