"""Comparison of a batch and the world over random joint steps."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from robotouille import State, World
from robotouille.batch.batch_world import BatchStep

__all__ = ["Batch", "agree", "world_of"]


class Batch(Protocol):
    """Engine under test: `BatchWorld` or another engine."""

    action_counts: tuple[int, ...]

    @property
    def overflowed(self) -> npt.NDArray[np.bool_]: ...
    def step(self, actions: npt.NDArray[np.int64]) -> BatchStep: ...
    def masks(self, player: str) -> npt.NDArray[np.bool_]: ...
    def vectors(self) -> npt.NDArray[np.float32]: ...
    def state(self, copy: int) -> State: ...
    def set_state(self, copy: int, state: State) -> None: ...


def world_of(name: str) -> World:
    """Return the world of a task, whose name may end in a timing profile: `workshop/02:people`."""
    from robotouille import load_task
    from tests.world.kitchens import bolt_recycler

    if name == "bolts":
        return bolt_recycler()
    task, _, timing = name.partition(":")
    return World(load_task(task, timing=timing) if timing else load_task(task))


def agree(
    batch: Batch,
    world: World,
    copies: int,
    steps: int,
    seed: int,
    states: Sequence[State] | None = None,
) -> int:
    """Take random steps in both: mostly valid actions, some invalid ones, and some without action.

    Sometimes a copy is set to its own state or to the initial one. The first states are `states`,
    or the initial state.

    Returns:
        The number of times a copy reached the goal or overflowed.
    """
    choose = random.Random(seed)
    states = list(states or [world.initial] * copies)
    for copy, state in enumerate(states):
        batch.set_state(copy, state)
    ends = 0
    for step in range(steps):
        compare(batch, world, states)
        joint = np.array([chosen(batch, world, state, choose) for state in states])
        result = batch.step(joint)
        for copy, state in enumerate(states):
            actions = {
                player: action
                for player, number in zip(world.players, joint[copy].tolist(), strict=True)
                if number >= 0
                and (action := world.encoding.action(state.facts, player, number)) is not None
            }
            expected = world.step(state, actions)
            states[copy] = expected.state
            if batch.overflowed[copy]:
                check_overflow(world, state, expected.state)
            else:
                applied = dict(zip(actions, (a.applied for a in expected.attempts), strict=True))
                assert result.applied[copy].tolist() == [
                    applied.get(player, False) for player in world.players
                ], step
                assert result.terminated[copy] == expected.goal_reached
                assert result.rewards[copy] == expected.reward
            if batch.overflowed[copy] or choose.random() < 0.003:
                ends += bool(batch.overflowed[copy])
                states[copy] = world.initial
                batch.set_state(copy, world.initial)
            elif choose.random() < 0.01:
                check_order(batch, world, states[copy], copy)
                batch.set_state(copy, batch.state(copy))
            ends += expected.goal_reached
    compare(batch, world, states)
    return ends


def compare(batch: Batch, world: World, states: list[State]) -> None:
    """Compare vectors and masks of all copies."""
    vectors = batch.vectors()
    expected = np.stack([state.vector() for state in states])
    wrong = np.argwhere(vectors != expected)
    assert not len(wrong), [world.encoding.columns[column] for _, column in wrong.tolist()]
    for player in world.players:
        masks = batch.masks(player)
        assert np.array_equal(masks, np.stack([state.mask(player) for state in states]))


def check_order(batch: Batch, world: World, state: State, copy: int) -> None:
    """Compare the order of the timers, which vectors do not contain."""
    names = world.encoding.slots.filled(state.facts)
    slots = {name: slot for slot, name in names.items() if name}
    rows = tuple(
        (action, index, tuple(slots.get(name, name) for name in arguments), counters)
        for action, index, arguments, counters in state.timer_rows()
    )
    found = batch.state(copy)
    assert found.timer_rows() == rows
    assert found.goal_reached == state.goal_reached


def check_overflow(world: World, before: State, after: State) -> None:
    """Check that some kind has no empty slot before or after the step."""
    for kind, slots in world.encoding.slots.by_kind.items():
        there = [
            sum(o.kind == kind and o.tile is None for o in state.objects)
            for state in (before, after)
        ]
        if max(there) >= len(slots):
            return
    raise AssertionError("the copy overflowed with empty slots")


def chosen(batch: Batch, world: World, state: State, choose: random.Random) -> list[int]:
    """Choose a number for each player (-1: no action), rare actions as often as walks."""
    joint = []
    for seat, player in enumerate(world.players):
        actions = state.actions(player)
        draw = choose.random()
        if draw < 0.08 or not actions:
            joint.append(-1)
        elif draw < 0.2:
            joint.append(choose.randrange(batch.action_counts[seat]))
        else:
            name = choose.choice(sorted({action.name for action in actions}))
            action = choose.choice([action for action in actions if action.name == name])
            joint.append(world.encoding.number(state.facts, player, action))
    return joint
