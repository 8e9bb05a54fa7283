"""Networks of actors and critics: two hidden layers, as plain arrays."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp

from robotouille_jax.padded import Array

Layers = tuple[tuple[Array, Array], ...]
"""Weights and biases of each layer."""


class Networks(NamedTuple):
    """Parameters that all seats share."""

    actor: Layers
    critic: Layers


def networks(key: Array, inputs: int, hidden: int, actions: int) -> Networks:
    """Return new networks. The last layer of an actor is small: at first it acts at random."""
    first, second = jax.random.split(key)
    return Networks(
        _layers(first, (inputs, hidden, hidden, actions), last=0.01),
        _layers(second, (inputs, hidden, hidden, 1), last=1.0),
    )


def output(layers: Layers, values: Array) -> Array:
    """Return a network's output."""
    for weights, biases in layers[:-1]:
        values = jax.nn.relu(values @ weights + biases)
    weights, biases = layers[-1]
    return values @ weights + biases


def _layers(key: Array, sizes: tuple[int, ...], last: float) -> Layers:
    layers = []
    for i, (inputs, outputs) in enumerate(pairwise(sizes)):
        gain = last if i == len(sizes) - 2 else 2**0.5
        key, draw = jax.random.split(key)
        weights = jax.random.normal(draw, (inputs, outputs)) * gain / inputs**0.5
        layers.append((weights, jnp.zeros(outputs)))
    return tuple(layers)
