"""Comparison of the fast world and the reference over random walks."""

from __future__ import annotations

import random
from itertools import product

from robotouille import GroundAction, State, Task, World
from tests.world.reference import Call, Reference, ReferenceState

__all__ = ["WALKS", "compare", "walk_both"]

WALKS = [
    ("synchronous/01", "benchmark", 60),
    ("synchronous/02", "people", 40),
    ("asynchronous/05", "benchmark", 40),
    ("asynchronous/06", "benchmark", 150),
    ("multi_agent/01@2", "benchmark", 80),
    ("multi_agent/01@4", "benchmark", 60),
    ("multi_agent/01@4", "people", 60),
    ("multi_agent/07", "benchmark", 40),
    ("workshop/01", "benchmark", 120),
    ("workshop/02", "benchmark", 120),
    ("workshop/02", "people", 80),
]
"""Shipped tasks: name, timing and number of steps."""


def walk_both(task: Task, steps: int, seed: int) -> int:
    """Walk randomly in both worlds and return the number of applied actions."""
    choose = random.Random(seed)
    world, reference = World(task), Reference(task)
    state, expected = world.initial, reference.initial
    compare(world, state, reference, expected)
    count = 0
    for _ in range(steps):
        joint = [
            (player, call)
            for player in choose.sample(world.players, choose.randint(0, len(world.players)))
            for call in [choose_call(world, state, player, choose)]
        ]
        actions = {player: world.action(name, *arguments) for player, (name, arguments) in joint}
        result = world.step(state, actions)
        after, applied = reference.step(expected, joint)
        assert [attempt.applied for attempt in result.attempts] == applied, joint
        assert [bool(attempt.unmet) for attempt in result.attempts] == [not a for a in applied]
        compare(world, result.state, reference, after)
        compare_changes(world, state, result.state, reference, expected, after)
        if len(actions) == 1 and applied == [True]:
            assert world.successor(state, *actions.values()) == result.state
        state, expected = result.state, after
        count += sum(applied)
    return count


def choose_call(world: World, state: State, player: str, choose: random.Random) -> Call:
    """Choose mostly a valid action of the player, sometimes any action."""
    valid = state.actions(player)
    if valid and choose.random() < 0.8:
        # Rarer actions as often as the many ways to walk somewhere.
        name = choose.choice(sorted({action.name for action in valid}))
        action = choose.choice([action for action in valid if action.name == name])
        return action.name, action.arguments
    while True:
        schema = choose.choice(world.schemas)
        pools = [[o.name for o in world.all_objects() if o.type == k] for _, k in schema.parameters]
        if schema.player and player in pools[0]:
            pools[0] = [player]
        if all(pools):
            return schema.name, tuple(choose.choice(pool) for pool in pools)


def compare(world: World, state: State, reference: Reference, expected: ReferenceState) -> None:
    """Compare all observable parts of a state."""
    assert set(state.atoms()) == expected.facts
    assert list(state.timer_rows()) == expected.timer_rows()
    assert {p: state.busy_steps(p) for p in world.players if state.busy_steps(p)} == expected.busy
    assert {o.name for o in state.objects} == set(expected.objects)
    assert state.goal_reached == reference.goal_reached(expected)
    for player in world.players:
        actions = [(a.name, a.arguments) for a in state.actions(player)]
        assert actions == reference.valid(expected, player)


def compare_changes(
    world: World,
    before: State,
    after: State,
    reference: Reference,
    expected_before: ReferenceState,
    expected_after: ReferenceState,
) -> None:
    """Compare the difference between two states; static facts end with their object."""
    added, removed = world.changes(before, after)
    assert set(added) == expected_after.facts - expected_before.facts
    gone = expected_before.facts - expected_after.facts
    assert set(removed) == {f for f in gone if f[0] not in world.table.static_predicates}


def all_actions(world: World) -> list[GroundAction]:
    """Return every action with all possible arguments."""
    found = []
    for schema in world.schemas:
        pools = [[o.name for o in world.all_objects() if o.type == k] for _, k in schema.parameters]
        found += [world.action(schema.name, *arguments) for arguments in product(*pools)]
    return found
