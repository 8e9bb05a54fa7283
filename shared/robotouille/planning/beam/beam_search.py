"""Beam search over joint steps, which keeps the best states of each step.

Layers are steps of the episode. So delays pass as in play, and the first layer with a goal state
gives the length of the plan. Within a step the players of the team choose one after another in seat
order, each after the choices of the earlier ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from random import Random
from typing import NamedTuple

from robotouille.planning.beam.projection import DEAD
from robotouille.planning.beam.remaining_work_heuristic import HeuristicContext, RemainingWork
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.timers import Timers
from robotouille.world.world import State, World


class Relevance:
    """Filter of actions that may help from one start towards one goal.

    A station is relevant if the goal names it, if its kind is needed for some action, if a relevant
    object lies there, or as one of a few spare places. An object is relevant if the goal or its
    support is about it, or if it lies in the way.
    """

    def __init__(
        self, context: HeuristicContext, state: State, heuristic: RemainingWork, players: int
    ) -> None:
        self._analysis = context.analysis
        self._world = context.world
        self._facts = state.facts
        wanted = set(heuristic.binding.values())
        for part in heuristic.parts:
            for projection in part.projections:
                wanted.update(projection.focus.names)
        self._around = self._neighbourhoods()
        self.stations = {n for n in wanted if n in self._analysis.stations}
        self.stations |= self._special()
        self.movables = {n for n in wanted if n not in self._analysis.stations}
        for name in sorted(self.movables):
            self.stations |= self._around.get(name, set()) & set(self._analysis.stations)
        # Free stations of one kind are equivalent; no more are needed than there are players, plus
        # one.
        self.stations |= self._spare(players + 1)
        for station in sorted(self.stations) + list(self._world.players):
            self.movables |= self._around.get(station, set())
        self._allowed: dict[GroundAction, bool] = {}

    def __call__(self, action: GroundAction) -> bool:
        """Return whether a search should try an action."""
        found = self._allowed.get(action)
        if found is None:
            found = self._allowed[action] = self._judge(action)
        return found

    def _judge(self, action: GroundAction) -> bool:
        if self._analysis.is_idle(action):
            return False
        for name in action.arguments:
            thing = self._world.thing(name)
            if thing.type in self._analysis.station_types:
                start = action.name in self._analysis.walking
                if name not in self.stations and not (start and name == self._leaving(action)):
                    return False
                continue
            movable = self._analysis.is_movable(thing.type) and thing.tile is not None
            if movable and name not in self.movables:
                return False
        return True

    def _leaving(self, action: GroundAction) -> str:
        """Return the origin of a walk, which is the first station it names."""
        return next(n for n in action.arguments if n in self._analysis.stations)

    def _neighbourhoods(self) -> dict[str, set[str]]:
        """Return for each object the others that share a true fact with it."""
        around: dict[str, set[str]] = {}
        for position in bits_of(self._facts & ~self._world.table.internal):
            names = self._world.table.atoms[position][1:]
            for name in names:
                around.setdefault(name, set()).update(n for n in names if n != name)
        return around

    def _roles(self, station: str) -> tuple[str, ...]:
        """Return the static predicates of a station that some action requires."""
        asked = {c.predicate for s in self._world.schemas for c in s.definition.precons}
        static = self._world.table.static
        return tuple(sorted(p for p in asked if (p, station) in static))

    def _special(self) -> set[str]:
        return {s for s in self._analysis.stations if self._roles(s)}

    def _spare(self, number: int) -> set[str]:
        """Return empty stations: those between crews first, then those near the relevant ones."""
        players = set(self._world.players)
        free = [
            s
            for s in self._analysis.stations
            if s not in self.stations and not self._around.get(s, set()) - players
        ]
        floor = self._world.floor
        chosen = sorted(self.stations)
        crews = self._analysis.crews_at
        free.sort(key=lambda s: (-crews(s), sum(floor.distance(s, other) for other in chosen)))
        return set(free[:number])


PATIENCE = 14
"""Layers without progress after which a search gives up, times the factor of delays."""

Joint = tuple[GroundAction, ...]


class BeamNode(NamedTuple):
    """A state of a layer or within a step, and its origin."""

    facts: int
    timers: Timers
    parent: BeamNode | None
    joint: Joint
    score: float
    actions: float


@dataclass(frozen=True, slots=True)
class SearchStyle:
    """Parameters of a search.

    `width` is the number of states per layer. `effort` is the additional cost of an action, which
    prefers states with fewer actions. `chain` is the weight of the longest piece of work.
    """

    width: int
    effort: float = 0.0
    chain: float = 0.0


@dataclass(frozen=True, slots=True)
class BeamResult:
    """Result of a search: joint actions to the goal or to the most promising state.

    `remaining_work` is the heuristic of the last state (0 at the goal).
    """

    steps: tuple[Joint, ...]
    reached: bool
    remaining_work: float
    expansions: int


class BeamSearch:
    """A search from one state for one choice of objects and one team of players."""

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
        """Search for plans shorter than `limit` steps with at most `expansions`.

        Raises:
            StoppedError: The heuristic's context has to stop.
        """
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
        """Return the next layer."""
        nodes = [BeamNode(n.facts, n.timers, n, (), n.score, n.actions) for n in layer]
        for player in self._team[:-1]:
            nodes = self._select(self._scored(self._choose(nodes, player)))
        return self._select(self._scored(self._ended(self._choose(nodes, self._team[-1]))))

    def _choose(self, nodes: list[BeamNode], player: str) -> list[BeamNode]:
        """Return every choice of one player in every node."""
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
        """Let the time of a step pass and yield the states that are new."""
        seen = self._seen
        for node in nodes:
            facts, timers, parent, joint, score, actions = node
            if timers.pending:
                touched, removed, timers = timers.tick(facts)
                facts = (facts | touched) ^ removed
            if (facts, timers) not in seen:
                seen.add((facts, timers))
                yield BeamNode(facts, timers, parent, joint, score, actions)

    def _scored(self, nodes: Iterable[BeamNode]) -> Iterator[BeamNode]:
        for facts, timers, parent, joint, _, actions in nodes:
            self._heuristic.check_stop()
            yield BeamNode(facts, timers, parent, joint, self._score(facts, timers), actions)

    def _select(self, nodes: Iterator[BeamNode]) -> list[BeamNode]:
        """Return the best nodes."""
        # Random tie-breaking keeps the nodes of a layer diverse.
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
