"""New first states of a world from a seed, in a few milliseconds (docs/train.md)."""

from __future__ import annotations

from collections.abc import Iterator

from robotouille.generation.parameters import SeededRng
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World

STEPS_PER_THING = 6
"""Steps of a walk for each movable thing. Half of the things then stand somewhere else."""

ATTEMPTS = 10
"""Maximum number of walks: one that ends where the goal is reached is followed by another."""


def shuffled(world: World, seed: int) -> State:
    """Return a first state in which things are in other places, and the players too.

    The players walk at random and take only steps that they can undo. So the state has a plan if
    the world's own first state has one, and the arrays of the world have room for it.
    """
    for attempt in range(ATTEMPTS):
        state = _walked(world, SeededRng(f"shuffled {seed} {attempt}"))
        if not state.goal_reached:
            return state
    return world.initial


def _walked(world: World, rng: SeededRng) -> State:
    facts, players = world.initial.facts, world.players
    stations = len(world.floor.stations)
    for _ in range(STEPS_PER_THING * (len(world.placed) - stations)):
        player = rng.one_of(players)
        facts = next(_undoable(world, facts, player, rng), facts)
    return _at_rest(world, facts)


def _at_rest(world: World, facts: int) -> State:
    """Return a state without running effects, at the beginning of a shift."""
    return State(world, facts, world.timers.none, world.initial.orders)


def _undoable(world: World, facts: int, player: str, rng: SeededRng) -> Iterator[int]:
    """Yield the facts after random steps of a player that another step undoes."""
    by_name: dict[str, list[GroundAction]] = {}
    for action in _simple(world, facts, player):
        by_name.setdefault(action.name, []).append(action)
    # A player has far more ways to walk than to pick something up, so the kind of action is chosen
    # first.
    for name in rng.shuffled(list(by_name)):
        after = _applied(facts, rng.one_of(by_name[name]))
        back = (_applied(after, action) for action in _simple(world, after, player))
        if after != facts and facts in back:
            yield after


def _simple(world: World, facts: int, player: str) -> Iterator[GroundAction]:
    """Yield a player's valid actions that start no effects and take one step."""
    for action in world.actions(_at_rest(world, facts), player):
        if not action.effects and action.duration == 1:
            yield action


def _applied(facts: int, action: GroundAction) -> int:
    return (facts | action.touched) ^ action.removed
