"""Exact distances of an object to its goal in a projection of the task."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from typing import NamedTuple

from robotouille.planning.beam.domain_analysis import DomainAnalysis
from robotouille.planning.beam.object_operators import WAITING, Focus, Operator, operators
from robotouille.world.grounding.atoms import EXISTS, bits_of
from robotouille.world.grounding.effects import HOLDING, Effect
from robotouille.world.grounding.objects import Atom
from robotouille.world.timers import Timers
from robotouille.world.world import World

MAX_KEPT = 100_000
MAX_STEPS = 10_000


class Forecast(NamedTuple):
    """The facts after all running delays have ended: `(facts | touched) ^ removed`.

    `waiting` is the cost of the remaining delays and `longest` their steps. `repeated` contains the
    effects of repeated actions that have begun, with the number of their performances.
    """

    touched: int
    removed: int
    waiting: float
    longest: int
    repeated: tuple[tuple[Effect, float], ...]


NOTHING = Forecast(0, 0, 0.0, 0, ())


class Forecaster:
    """Simulator of timers while nobody acts, with a cache."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._known: dict[tuple[Timers, int], Forecast] = {}

    def __call__(self, facts: int, timers: Timers) -> Forecast:
        """Return the forecast for a state."""
        if not timers.entries:
            return NOTHING
        key = (timers, facts & (timers.reads | self._world.table.internal))
        found = self._known.get(key)
        if found is None:
            if len(self._known) > MAX_KEPT:
                self._known.clear()
            found = self._known[key] = self._run(facts, timers)
        return found

    def _run(self, facts: int, timers: Timers) -> Forecast:
        repeated = _repeated(timers)
        touched = removed = longest = 0
        waiting = 0.0
        timers = self._world.timers.get(timers.entries, ())
        for _ in range(MAX_STEPS):
            if not timers.entries:
                break
            change = timers.tick(facts)
            if change.timers is timers:
                break
            facts = (facts | change.touched) ^ change.removed
            removed = (removed & ~change.touched) | change.removed
            touched |= change.touched
            timers = change.timers
            running = sum(1 for effect, progress in timers.entries if _runs(effect, progress))
            waiting += WAITING * running
            longest += bool(running)
        return Forecast(touched, removed, waiting, longest, repeated)


def _runs(effect: Effect, progress: tuple[int, ...]) -> bool:
    held = not effect.root.pauses or progress[0] == HOLDING
    return held and any(n.counts == "steps" and progress[n.slot] >= 0 for n in effect.counters())


def _repeated(timers: Timers) -> tuple[tuple[Effect, float], ...]:
    return tuple(
        (effect, float(progress[node.slot]))
        for effect, progress in timers.entries
        for node in effect.counters()
        if node.counts == "performances" and progress[node.slot] > 0
    )


DEAD = 1000.0
"""Distance of states from which the goal cannot be reached."""

MAX_NODES = 4000

ANYWHERE = ""
"""Place of a player who still has to walk to the next operator."""

Key = tuple[int, str]


class Projection:
    """Distances to a goal, in steps of one player, from every node of a projection.

    A node contains the facts about the focus. Distances also depend on the place of the player who
    deals with it. The graph is explored from the nodes that are requested.
    """

    def __init__(
        self,
        analysis: DomainAnalysis,
        names: tuple[str, ...],
        goal: frozenset[Atom],
        guest: Atom | None = None,
    ) -> None:
        self._analysis = analysis
        guests = () if guest is None else (guest,)
        mentioned = sorted({*goal, *guests})
        others = (n for atom in mentioned for n in analysis.movables_in(atom))
        partners = tuple(dict.fromkeys(n for n in others if n not in names))
        stations = frozenset(s for atom in mentioned for s in analysis.stations_in(atom))
        self.focus = Focus(analysis, names, partners, stations, guests)
        table = analysis.world.table
        self._goal = self.focus.mask(
            self.focus.abstract(a) for a in mentioned if a[0] not in table.static_predicates
        )
        self.operators = operators(self.focus, self._goal)
        self._tracked = self._goal
        for operator in self.operators:
            for outcome in (operator.condition, *operator.outcomes):
                self._tracked |= outcome.holds | outcome.lacks
        self._by_bit = _by_bit(self.operators)
        self.placeholders = {s for operator in self.operators for s in operator.placeholders}
        self.sources = {s for o in self.operators if self._creates(o) for s in o.placeholders}
        self._explored: dict[int, list[tuple[Operator, int]]] = {}
        self._incoming: dict[int, list[tuple[int, Operator]]] = {}
        self._distance: dict[Key, float] = {}
        self._nodes: dict[int, int] = {}
        self.mask = _mask(analysis, names, stations)

    def _creates(self, operator: Operator) -> bool:
        """Return whether an operator creates an object of the focus."""
        born = self.focus.mask((EXISTS, name) for name in self.focus.names)
        return any(outcome.sets & born for outcome in operator.outcomes)

    def node(self, facts: int) -> int:
        """Return the node of a state's facts."""
        facts &= self.mask
        known = self._nodes.get(facts)
        if known is None:
            known = 0
            atoms = self._analysis.world.table.atoms
            for position in bits_of(facts):
                known |= self.focus.bits.get(self.focus.abstract(atoms[position]), 0)
            known &= self._tracked
            self._nodes[facts] = known
        return known

    def distance(self, node: int, place: str = ANYWHERE) -> float:
        """Return the steps to the goal from a node for a player at a place, or DEAD."""
        if node not in self._explored:
            self._explore(node)
            self._measure()
        anywhere = self._distance.get((node, ANYWHERE), DEAD)
        return min(anywhere, self._distance.get((node, place), anywhere))

    def near(self, node: int) -> list[str]:
        """Return the places at which the work can continue without another walk."""
        nearer = self.nearer(node)
        found: dict[str, None] = {}
        for operator, after in self._explored[node]:
            place = operator.place
            if place in nearer:
                through = operator.cost + self.distance(after, place)
                if through < nearer[place] + 1e-6:
                    found[place] = None
        return list(found)

    def nearer(self, node: int) -> dict[str, float]:
        """Return the distances from the places that save a walk."""
        anywhere = self.distance(node)
        places = {o.place for o, _ in self._explored[node] if o.place is not None}
        found = {s: self._distance.get((node, s), DEAD) for s in places}
        return {s: steps for s, steps in found.items() if steps < anywhere}

    @property
    def has_dead_ends(self) -> bool:
        """True if some explored node cannot reach the goal."""
        return any((node, ANYWHERE) not in self._distance for node in self._explored)

    def _explore(self, start: int) -> None:
        frontier = [start]
        while frontier:
            node = frontier.pop()
            if node in self._explored:
                continue
            successors = self._explored[node] = []
            if node & self._goal == self._goal or len(self._explored) > MAX_NODES:
                continue
            for position in (-1, *bits_of(node)):
                for operator in self._by_bit.get(position, ()):
                    condition = operator.condition
                    if node & condition.holds != condition.holds or node & condition.lacks:
                        continue
                    after = operator.apply(node)
                    if after != node:
                        successors.append((operator, after))
                        self._incoming.setdefault(after, []).append((node, operator))
                        frontier.append(after)

    def _measure(self) -> None:
        """Compute all distances backwards from the goal with Dijkstra's algorithm."""
        # Only places where a node has work are keys. From any other place the distance is the one
        # from ANYWHERE. Unexplored nodes get an estimate.
        travel = self._analysis.travel_to
        distance = self._distance = {}
        queue = [(d, n, key) for n, (d, key) in enumerate(self._ends())]
        heapq.heapify(queue)
        order = len(queue)
        while queue:
            steps, _, key = heapq.heappop(queue)
            if key in distance:
                continue
            distance[key] = steps
            node, place = key
            reached = []
            if place != ANYWHERE:
                reached.append((steps + travel[place], (node, ANYWHERE)))
            for before, operator in self._incoming.get(node, ()):
                if operator.place is None or operator.place == place:
                    reached.append((steps + operator.cost, (before, place)))
                elif place == ANYWHERE:
                    reached.append((steps + operator.cost, (before, operator.place)))
            for further, other in reached:
                if other not in distance:
                    order += 1
                    heapq.heappush(queue, (further, order, other))

    def _ends(self) -> Iterator[tuple[float, Key]]:
        """Yield the distances of goal nodes, and estimates for unexplored nodes."""
        full = len(self._explored) > MAX_NODES
        for node, successors in self._explored.items():
            if node & self._goal == self._goal:
                yield 0.0, (node, ANYWHERE)
            elif full and not successors:
                yield 4.0 * (self._goal & ~node).bit_count(), (node, ANYWHERE)


def _by_bit(operators: list[Operator]) -> dict[int, list[Operator]]:
    """Return operators by the position of one required fact; -1 for those without any."""
    found: dict[int, list[Operator]] = {}
    for operator in operators:
        needed = operator.condition.holds
        found.setdefault(needed.bit_length() - 1, []).append(operator)
    return found


def _mask(analysis: DomainAnalysis, names: tuple[str, ...], stations: frozenset[str]) -> int:
    """Return the world's atoms on which a node depends."""
    table = analysis.world.table
    mask = 0
    for name in names:
        mask |= table.mentions(name)
    for predicate in table.fluents:
        kinds = table.types[predicate]
        if predicate not in analysis.walked and set(kinds) <= analysis.station_types:
            for station in sorted(stations):
                if (predicate, station) in table.bit:
                    mask |= table.bit[(predicate, station)]
    return mask
