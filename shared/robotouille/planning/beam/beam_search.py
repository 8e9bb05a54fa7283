"""Beam search over joint steps: the best few states of each step are kept.

Layers are steps of the episode, so delays pass as they do in play and the first layer that holds
a goal gives the length of the plan. Within a step the players of the team choose one after the
other, in seat order, each knowing what those before it do.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from random import Random
from typing import NamedTuple

from robotouille.planning.beam.projection import DEAD
from robotouille.planning.beam.relevance import Relevance
from robotouille.planning.beam.remaining_work_heuristic import RemainingWork
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.timers import Timers
from robotouille.world.world import State, World

__all__ = ["BeamResult", "BeamSearch", "Joint", "SearchStyle"]

PATIENCE = 14
"""Layers without progress after which a search gives up, besides the longest delay."""

Joint = tuple[GroundAction, ...]


class BeamNode(NamedTuple):
    """A state of a layer, or within a step, and how it came about."""

    facts: int
    timers: Timers
    parent: BeamNode | None
    joint: Joint
    score: float
    actions: float


@dataclass(frozen=True, slots=True)
class SearchStyle:
    """How a search goes about it.

    `width` is the number of states kept per layer, `effort` what an action costs besides its time
    (of equal states the lazier is kept), `chain` the weight of the longest piece of work.
    """

    width: int
    effort: float = 0.0
    chain: float = 0.0


@dataclass(frozen=True, slots=True)
class BeamResult:
    """What a search found: joint actions to the goal, or to the most promising state seen.

    `remaining_work` is the heuristic of the last state (0 at the goal), `expansions` the number of
    states expanded.
    """

    steps: tuple[Joint, ...]
    reached: bool
    remaining_work: float
    expansions: int


class BeamSearch:
    """A search from one state, for one choice of objects and one team of players."""

    def __init__(
        self,
        world: World,
        start: State,
        heuristic: RemainingWork,
        relevance: Relevance,
        team: Sequence[str],
    ) -> None:
        self._world = world
        self._start = start
        self._heuristic = heuristic
        self._relevance = relevance
        self._team = tuple(team)
        self._style = SearchStyle(1)
        self._random = Random(0)
        self._spent = 0
        self._seen: set[tuple[int, Timers]] = set()
        self._patience = PATIENCE * world.task.profile.delay_factor
        self._options: dict[tuple[GroundAction, ...], list[GroundAction]] = {}

    def run(self, style: SearchStyle, seed: int, limit: int, expansions: int) -> BeamResult:
        """Search for plans shorter than `limit` steps, expanding at most so many states."""
        start = self._start
        goal = self._heuristic.goal
        if start.facts & goal == goal:
            return BeamResult((), True, 0.0, 0)
        self._style, self._random, self._spent = style, Random(seed), 0
        self._seen = {(start.facts, start.timers)}
        score = self._score(start.facts, start.timers)
        best = BeamNode(start.facts, start.timers, None, (), score, 0.0)
        layer = [best]
        stale = 0
        for _ in range(limit - 1):
            layer = self._next(layer)
            if not layer:
                break
            for node in layer:
                if node.facts & goal == goal:
                    return BeamResult(_steps(node), True, 0.0, self._spent)
            stale += 1
            if layer[0].score < best.score - 1e-9:
                best, stale = layer[0], 0
            if stale > self._patience or self._spent > expansions:
                break
        return BeamResult(_steps(best), False, best.score, self._spent)

    def _score(self, facts: int, timers: Timers) -> float:
        return self._heuristic(facts, timers, self._style.chain)

    def _next(self, layer: list[BeamNode]) -> list[BeamNode]:
        """The layer that follows."""
        nodes = [BeamNode(n.facts, n.timers, n, (), n.score, n.actions) for n in layer]
        for player in self._team[:-1]:
            nodes = self._select(self._scored(self._choose(nodes, player)))
        return self._select(self._scored(self._ended(self._choose(nodes, self._team[-1]))))

    def _choose(self, nodes: list[BeamNode], player: str) -> list[BeamNode]:
        """Every choice of one player in every node."""
        world, effort = self._world, self._style.effort
        result: list[BeamNode] = []
        known: set[tuple[int, Timers]] = set()
        self._spent += len(nodes)
        for node in nodes:
            facts, timers, parent, joint, score, actions = node
            if (facts, timers) not in known:
                known.add((facts, timers))
                result.append(node)
            if timers.busy and timers.busy_steps(player):
                continue
            actions += effort
            for action in self._actions(world.actions(State(world, facts, timers), player)):
                after = (facts | action.touched) ^ action.removed
                timers_after = timers
                if action.effects or action.duration > 1:
                    touched, removed, timers_after = timers.begin(action, after)
                    after = (after | touched) ^ removed
                if (after, timers_after) not in known:
                    known.add((after, timers_after))
                    result.append(
                        BeamNode(after, timers_after, parent, (*joint, action), score, actions)
                    )
        return result

    def _actions(self, valid: tuple[GroundAction, ...]) -> list[GroundAction]:
        options = self._options.get(valid)
        if options is None:
            options = self._options[valid] = [a for a in valid if self._relevance(a)]
        return options

    def _ended(self, nodes: list[BeamNode]) -> Iterator[BeamNode]:
        """Let the step's time pass; states that were there before are left out."""
        seen = self._seen
        for node in nodes:
            facts, timers, parent, joint, score, actions = node
            if timers.entries or timers.busy:
                touched, removed, timers = timers.tick(facts)
                facts = (facts | touched) ^ removed
            if (facts, timers) not in seen:
                seen.add((facts, timers))
                yield BeamNode(facts, timers, parent, joint, score, actions)

    def _scored(self, nodes: Iterable[BeamNode]) -> Iterator[BeamNode]:
        for facts, timers, parent, joint, _, actions in nodes:
            yield BeamNode(facts, timers, parent, joint, self._score(facts, timers), actions)

    def _select(self, nodes: Iterator[BeamNode]) -> list[BeamNode]:
        """The best nodes; ties are broken at random, so that they do not all look alike."""
        draw = self._random.random
        ranked = [(n.score + n.actions, draw(), n) for n in nodes if n.score < DEAD]
        ranked.sort()
        return [node for _, _, node in ranked[: self._style.width]]


def _steps(node: BeamNode) -> tuple[Joint, ...]:
    steps: list[Joint] = []
    current: BeamNode | None = node
    while current is not None and current.parent is not None:
        steps.append(current.joint)
        current = current.parent
    return tuple(reversed(steps))
