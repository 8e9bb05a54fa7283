"""Trained networks as files that play without JAX."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robotouille.planning.policies.trained import Actor, layout_of, write_actor
from robotouille.world.world import World
from robotouille_jax.learning.network import Layers
from robotouille_jax.learning.views import Views


def write_weights(path: Path, world: World, views: Views, layers: Layers, name: str) -> None:
    """Write the layers of an actor."""
    arrays = tuple(
        (np.asarray(weights, np.float32), np.asarray(biases, np.float32))
        for weights, biases in layers
    )
    layout = layout_of(world.encoding, world.players)
    task = f"{world.task.name}@{len(world.players)}"
    write_actor(path, Actor(name, task, layout, views.columns, views.scale, arrays))
