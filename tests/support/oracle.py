"""Exact distances to the goal by brute force, following the semantics in docs/episodes.md.

The search uses no heuristics, symmetries or bit sets. It tries every joint action in every order,
breadth first. Each state is stored with the same state of the fast world, reached by `World.step`,
so that tests can query planners about it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from robotouille import State, Task, World
from robotouille.domain.schema import ActionDef
from tests.world.reference import Call, Reference, ReferenceState

__all__ = ["Oracle", "explore"]

Key = tuple[object, ...]
Sequence = tuple[tuple[str, Call], ...]

STEPS_PER_STATE = 10
"""Limit of steps per state: with `cap` states, at most this many times `cap` steps are tried."""


@dataclass
class Oracle:
    """The reachable states, up to a limit, in order of their distance from the start.

    `complete` is true if there are no other states. `depth` is the length of a shortest plan, or
    None if these states contain no plan. Any plan outside these states has more than `layers`
    steps.
    """

    complete: bool = False
    depth: int | None = None
    layers: int = 0
    steps: int = 0
    states: dict[Key, State] = field(default_factory=dict)
    goals: set[Key] = field(default_factory=set)
    edges: dict[Key, list[Key]] = field(default_factory=dict)

    def distances(self) -> dict[Key, int]:
        """Return each state's distance to the goal; states without a path are missing."""
        sources: dict[Key, list[Key]] = {}
        for source, targets in self.edges.items():
            for target in targets:
                sources.setdefault(target, []).append(source)
        found = dict.fromkeys(self.goals, 0)
        queue = deque(self.goals)
        while queue:
            target = queue.popleft()
            for source in sources.get(target, ()):
                if source not in found:
                    found[source] = found[target] + 1
                    queue.append(source)
        return found


class _Reference(Reference):
    """Reference world that caches the parameters of actions."""

    def __init__(self, task: Task) -> None:
        self._parameters: dict[str, list[tuple[str, str]]] = {}
        super().__init__(task)

    def parameters(self, action: ActionDef) -> list[tuple[str, str]]:
        if action.name not in self._parameters:
            self._parameters[action.name] = super().parameters(action)
        return self._parameters[action.name]


def explore(task: Task, world: World, cap: int, *, with_goal: bool = True) -> Oracle:
    """Explore a task's reachable states, up to `cap` of them."""
    reference, oracle = _Reference(task), Oracle()
    first = _key(reference.initial)
    layer = {first: reference.initial}
    oracle.states[first] = world.initial
    while layer:
        for key, state in layer.items():
            if with_goal and reference.goal_reached(state):
                oracle.goals.add(key)
                if oracle.depth is None:
                    oracle.depth = oracle.layers
            assert not with_goal or oracle.states[key].goal_reached == (key in oracle.goals)
        following: dict[Key, ReferenceState] = {}
        for key, state in layer.items():
            targets = []
            for target in _steps(reference, oracle, key, state, following):
                targets.append(target)
                oracle.steps += 1
                if len(oracle.states) > cap or oracle.steps > STEPS_PER_STATE * cap:
                    return oracle
            oracle.edges[key] = targets
        oracle.layers += 1
        layer = following
    oracle.complete = True
    return oracle


def _steps(
    reference: Reference,
    oracle: Oracle,
    key: Key,
    state: ReferenceState,
    following: dict[Key, ReferenceState],
) -> Iterator[Key]:
    twin = oracle.states[key]
    world = twin.world
    for joint in _joints(reference, state, ()):
        after, applied = reference.step(state, joint)
        assert all(applied)
        target = _key(after)
        if target not in oracle.states:
            actions = {player: world.action(name, *args) for player, (name, args) in joint}
            oracle.states[target] = world.step(twin, actions).state
            assert set(oracle.states[target].atoms()) == after.facts
            assert list(oracle.states[target].timer_rows()) == after.timer_rows()
            following[target] = after
        yield target


def _joints(reference: Reference, state: ReferenceState, taken: Sequence) -> Iterator[Sequence]:
    """Yield every order of valid actions with at most one action per player."""
    yield taken
    acted = {player for player, _ in taken}
    for player in reference.players:
        if player not in acted:
            for call in reference.valid(state, player):
                after = state.copy()
                reference.apply(after, call)
                yield from _joints(reference, after, (*taken, (player, call)))


def _key(state: ReferenceState) -> Key:
    return (
        frozenset(state.facts),
        tuple(state.timer_rows()),
        tuple(sorted(state.created.items())),
        tuple(sorted(state.busy.items())),
    )
