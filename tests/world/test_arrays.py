"""States as vectors and actions as numbers: nothing is lost, and nothing has two meanings."""

from __future__ import annotations

import random

import numpy as np
import pytest

from robotouille import State, World, load_task, task_names


def played(world: World, seed: int, steps: int) -> list[State]:
    """States on a random course of play."""
    rng = random.Random(seed)
    states = [world.initial]
    for _ in range(steps):
        valid = [states[-1].actions(player) for player in world.players]
        states.append(states[-1].step([rng.choice(each) if each else None for each in valid]).state)
    return states


@pytest.mark.parametrize("name", task_names())
def test_masks_and_vectors_say_all_of_a_state(name: str) -> None:
    world = World(load_task(name))
    encoding = world.encoding
    vectors: dict[bytes, State] = {}
    for state in played(world, 1, 120):
        for player in world.players:
            numbers = np.flatnonzero(state.mask(player))
            chosen = [encoding.action(state.facts, player, int(n)) for n in numbers]
            assert chosen == list(state.actions(player))
        vector = state.vector()
        assert vector.shape == (encoding.size,) == (len(encoding.columns),)
        assert vectors.setdefault(vector.tobytes(), state) == state
        true = {encoding.columns[i] for i in np.flatnonzero(vector[: len(encoding.atoms)])}
        assert true == {f"{p}({', '.join(a)})" for p, *a in encoding.atoms if holds(state, p, *a)}


def holds(state: State, predicate: str, *arguments: str) -> bool:
    bit = state.world.table.bit[predicate, *arguments]
    return bool(state.facts & bit)
