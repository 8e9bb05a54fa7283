"""Keys of states, and actions as integers."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import World
from robotouille.planners.kitchen.compact_state import (
    ACTION_BITS,
    decode_action,
    empty_state,
    encode_action,
    pack_state,
    unpack_state,
)
from robotouille.planners.kitchen.encode import encode
from robotouille.planners.kitchen.kernels import record, zeros
from robotouille.planners.kitchen.model import model_of
from tests.planning.kitchen.courses import contents, walk
from tests.planning.kitchen.random_kitchens import random_kitchen
from tests.support.thorough import thorough


@pytest.mark.slow
@thorough(60)
@given(seed=st.integers(0, 10_000), steps=st.integers(1, 40))
def test_keys_round_trip(seed: int, steps: int) -> None:
    """A state comes back from its key, and different states have different keys."""
    world = World(random_kitchen(seed))
    keys: dict[tuple[int, ...], list[list[int]]] = {}
    model = model_of(world, world.initial)
    assert model is not None
    kitchen = model.kitchen
    for search in walk(world, random.Random(seed), steps):
        state = search.start
        if any(o.type == "meal" and o.name not in model.meals for o in state.objects):
            return
        compact = encode(model, state)
        key, back = zeros(kitchen.words), record(empty_state(kitchen))
        pack_state(model.record, record(compact), key)
        unpack_state(model.record, key, 0, back)
        assert back.may_have_walked == compact.may_have_walked
        known = contents(kitchen, compact)
        assert contents(kitchen, back) == known
        whole = (*map(int, key), compact.may_have_walked)
        assert keys.setdefault(whole, known) == known


@pytest.mark.parametrize("kind", range(9))
def test_actions_round_trip(kind: int) -> None:
    for x, y in [(0, 0), (1, 0), (0, 1), (62, 0), (40, 6), (62, 6)]:
        action = encode_action(kind, x, y)
        assert 0 <= action < 1 << ACTION_BITS
        assert decode_action(action) == (kind, x, y)
