"""Beam search over joint steps: the best few states of each step are kept.

Layers are steps of the episode, so delays pass as they do in play and the first layer that holds
a goal gives the length of the plan. Within a step the players of the team choose one after the
other, in seat order, each knowing what those before it do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from random import Random
from typing import NamedTuple

from robotouille.planning.estimate import DEAD, Estimate
from robotouille.planning.relevance import Relevance
from robotouille.world.actions import GroundAction
from robotouille.world.state import State
from robotouille.world.timers import Timers
from robotouille.world.world import World

__all__ = ["Found", "Search"]

PATIENCE = 14
"""Layers without progress after which a search gives up, besides the longest delay."""

EFFORT = 0.1
"""What an action costs besides its time: among equal states, the lazier one is kept."""

Joint = tuple[GroundAction, ...]


class Node(NamedTuple):
    """A state of a layer, or within a step, and how it came about."""

    facts: int
    timers: Timers
    parent: Node | None
    joint: Joint
    score: float
    actions: float


@dataclass(frozen=True, slots=True)
class Found:
    """What a search found: joint actions to the goal, or to the most promising state seen.

    `left` is the estimate of the work left (0 at the goal), `expansions` the states expanded.
    """

    steps: tuple[Joint, ...]
    reached: bool
    left: float
    expansions: int


class Search:
    """A search from one state, for one choice of objects and one team of players."""

    def __init__(
        self,
        world: World,
        start: State,
        estimate: Estimate,
        relevance: Relevance,
        team: Sequence[str],
    ) -> None:
        self._world = world
        self._start = start
        self._estimate = estimate
        self._relevance = relevance
        self._team = tuple(team)
        self._options: dict[tuple[GroundAction, ...], list[GroundAction]] = {}

    def run(self, width: int, random: Random, limit: int, expansions: int) -> Found:
        """Search with a number of states per layer, for plans shorter than `limit` steps."""
        start = self._start
        score = self._estimate(start.facts, start.timers)
        root = best = Node(start.facts, start.timers, None, (), score, 0.0)
        goal = self._estimate.goal
        if start.facts & goal == goal:
            return Found((), True, 0.0, 0)
        layer = [root]
        seen: set[tuple[int, Timers]] = {(root.facts, root.timers)}
        spent = stale = 0
        for _ in range(limit - 1):
            spent += len(layer)
            layer = self._layer(layer, width, random, seen)
            if not layer or spent > expansions:
                break
            for node in layer:
                if node.facts & goal == goal:
                    return Found(_steps(node), True, 0.0, spent)
            stale += 1
            if layer[0].score < best.score - 1e-9:
                best, stale = layer[0], 0
            if stale > PATIENCE * self._slowness:
                break
        return Found(_steps(best), False, best.score, spent)

    @property
    def _slowness(self) -> int:
        return self._world.task.profile.delay_factor

    def _layer(
        self, layer: list[Node], width: int, random: Random, seen: set[tuple[int, Timers]]
    ) -> list[Node]:
        partial: list[Node] = [Node(n.facts, n.timers, n, (), n.score, n.actions) for n in layer]
        last = len(self._team) - 1
        for i, player in enumerate(self._team):
            partial = self._choose(partial, player)
            if i < last:
                partial = self._select(self._scored(partial), width, random)
        return self._select(self._ended(partial, seen), width, random)

    def _choose(self, nodes: list[Node], player: str) -> list[Node]:
        """Every choice of one player in every node."""
        world = self._world
        result: list[Node] = []
        known: set[tuple[int, Timers]] = set()
        for node in nodes:
            facts, timers, parent, joint, score, actions = node
            key = (facts, timers)
            if key not in known:
                known.add(key)
                result.append(node)
            if timers.busy and timers.busy_steps(player):
                continue
            for action in self._actions(world.actions(State(world, facts, timers), player)):
                after = (facts | action.touched) ^ action.removed
                timers_after = timers
                if action.effects or action.duration > 1:
                    touched, removed, timers_after = timers.begin(action, after)
                    after = (after | touched) ^ removed
                key = (after, timers_after)
                if key not in known:
                    known.add(key)
                    joint_after = (*joint, action)
                    result.append(Node(after, timers_after, parent, joint_after, score, actions + EFFORT))
        return result

    def _actions(self, valid: tuple[GroundAction, ...]) -> list[GroundAction]:
        options = self._options.get(valid)
        if options is None:
            options = self._options[valid] = [a for a in valid if self._relevance(a)]
        return options

    def _scored(self, nodes: list[Node]) -> Iterator[Node]:
        estimate = self._estimate
        for facts, timers, parent, joint, _, actions in nodes:
            yield Node(facts, timers, parent, joint, estimate(facts, timers), actions)

    def _ended(self, nodes: list[Node], seen: set[tuple[int, Timers]]) -> Iterator[Node]:
        """Let the step's time pass."""
        estimate = self._estimate
        for facts, timers, parent, joint, _, actions in nodes:
            if timers.entries or timers.busy:
                touched, removed, timers = timers.tick(facts)  # noqa: PLW2901
                facts = (facts | touched) ^ removed  # noqa: PLW2901
            key = (facts, timers)
            if key not in seen:
                seen.add(key)
                yield Node(facts, timers, parent, joint, estimate(facts, timers), actions)

    def _select(self, nodes: Iterator[Node], width: int, random: Random) -> list[Node]:
        """The best nodes; ties are broken at random, so that they do not all look alike."""
        ranked = [(node.score + node.actions, random.random(), node) for node in nodes if node.score < DEAD]
        ranked.sort()
        return [node for _, _, node in ranked[:width]]


def _steps(node: Node) -> tuple[Joint, ...]:
    steps: list[Joint] = []
    current: Node | None = node
    while current is not None and current.parent is not None:
        steps.append(current.joint)
        current = current.parent
    return tuple(reversed(steps))
