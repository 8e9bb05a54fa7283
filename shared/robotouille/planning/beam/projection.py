"""How far an object is from its goal: exact distances in a projection of the task."""

from __future__ import annotations

import heapq
from collections.abc import Iterator

from robotouille.planning.beam.domain_analysis import DomainAnalysis
from robotouille.planning.beam.object_operators import Focus, Operator, operators
from robotouille.world.grounding.atoms import EXISTS, bits_of
from robotouille.world.grounding.objects import Atom

__all__ = ["ANYWHERE", "DEAD", "Projection"]

DEAD = 1000.0
"""The distance where the goal cannot be reached any more."""

MAX_NODES = 4000

ANYWHERE = ""
"""The place of somebody who would still have to walk to wherever it is needed."""

Key = tuple[int, str]


class Projection:
    """Distances to a goal, in steps of one player, from every node of a projection.

    A node is the facts about the focus; distances also depend on where the player is that
    deals with it. The graph is explored from the nodes that are asked for.
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
        """Whether an operator brings an object of the focus into being."""
        born = self.focus.mask((EXISTS, name) for name in self.focus.names)
        return any(outcome.sets & born for outcome in operator.outcomes)

    def node(self, facts: int) -> int:
        """The node of a state's facts."""
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
        """The steps to the goal from a node, for somebody at a place; DEAD if there is no way."""
        if node not in self._explored:
            self._explore(node)
            self._measure()
        anywhere = self._distance.get((node, ANYWHERE), DEAD)
        return min(anywhere, self._distance.get((node, place), anywhere))

    def near(self, node: int) -> list[str]:
        """The places where the work can go on at once; from elsewhere it is a walk more."""
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
        """The distances from the places from which it is less far than from anywhere."""
        anywhere = self.distance(node)
        places = {o.place for o, _ in self._explored[node] if o.place is not None}
        found = {s: self._distance.get((node, s), DEAD) for s in places}
        return {s: steps for s, steps in found.items() if steps < anywhere}

    @property
    def has_dead_ends(self) -> bool:
        """Whether some node explored so far cannot reach the goal."""
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
        """Dijkstra's algorithm from the goal back; unexplored nodes count as near it.

        Only the places where a node has work are keys; elsewhere one is as far as anywhere.
        """
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
        """Where the way ends: at the goal, and where exploration did."""
        full = len(self._explored) > MAX_NODES
        for node, successors in self._explored.items():
            if node & self._goal == self._goal:
                yield 0.0, (node, ANYWHERE)
            elif full and not successors:
                yield 4.0 * (self._goal & ~node).bit_count(), (node, ANYWHERE)


def _by_bit(operators: list[Operator]) -> dict[int, list[Operator]]:
    """Operators by the position of one fact they need; -1 where they need none."""
    found: dict[int, list[Operator]] = {}
    for operator in operators:
        needed = operator.condition.holds
        found.setdefault(needed.bit_length() - 1, []).append(operator)
    return found


def _mask(analysis: DomainAnalysis, names: tuple[str, ...], stations: frozenset[str]) -> int:
    """The atoms of the world on which a node depends."""
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
