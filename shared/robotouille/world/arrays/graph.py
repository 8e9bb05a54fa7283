"""States as graphs with objects as nodes and relations as edges (docs/train.md)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robotouille.domain.schema import EffectDef, InstantEffect
from robotouille.world.grounding.atoms import EXISTS
from robotouille.world.grounding.effects import Effect
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, Object

EXISTING, BUSY = "exists", "busy"


class Graph(NamedTuple):
    """A state as a graph.

    Attributes:
        nodes: One row for each of `Encoding.objects`, with the numbers of `Encoding.features`.
        edges: One row for each relation that holds: its index in `Encoding.relations`, and the
            nodes of its subject and object.
        counters: One row for each edge: an active effect's counters, otherwise zeros.
    """

    nodes: npt.NDArray[np.float32]
    edges: npt.NDArray[np.int64]
    counters: npt.NDArray[np.float32]


class Link(NamedTuple):
    """Possible edge, with the positions of its truth and its counters in a vector."""

    place: int
    relation: str
    subject: str
    object: str
    counters: range = range(0)


class GraphLayout:
    """Mapping from the numbers of a vector to the nodes and edges of a graph.

    Args:
        task: The task.
        objects: Objects that are nodes.
        places: Position of each atom and effect in a vector.
        busy: Position of each player's busy steps in a vector.
        size: Length of a vector.
    """

    def __init__(
        self,
        task: GroundTask,
        objects: Sequence[Object],
        places: Mapping[Atom | Effect, int],
        busy: Mapping[str, int],
        size: int,
    ) -> None:
        self._node = {thing.name: i for i, thing in enumerate(objects)}
        types = task.table.types
        plain = [name for name, taken in types.items() if len(taken) < 2]
        self.features = (EXISTING, *task.task.domain.object_types, *plain, BUSY)
        static = [atom for atom in sorted(task.table.static) if self._node.keys() >= {*atom[1:]}]
        self._fixed = self._fixed_nodes(objects, [atom for atom in static if len(atom) < 3])
        links = [link for atom in static for link in links_of(atom, size)]
        links += [link for what, place in places.items() for link in links_of(what, place)]
        self.relations = tuple(_relations(task))
        self.counters = max((_size(e) for s in task.schemas for e in s.definition.sfx), default=0)
        self._read_nodes(places, busy, {thing.name for thing in objects if thing.tile is None})
        self._read_links(links, size)

    def _fixed_nodes(
        self, objects: Sequence[Object], static: Sequence[Atom]
    ) -> npt.NDArray[np.float32]:
        """Return the features that do not change while an object exists."""
        fixed = np.zeros((len(objects), len(self.features)), dtype=np.float32)
        for row, thing in enumerate(objects):
            fixed[row, [0, self.features.index(thing.type)]] = 1
        for atom in static:
            fixed[self._rows(atom), self.features.index(atom[0])] = 1
        return fixed

    def _rows(self, atom: Atom) -> list[int]:
        """Return the nodes of a fact about one object; a fact about none is about all nodes."""
        return [self._node[name] for name in atom[1:]] or list(self._node.values())

    def _read_nodes(
        self, places: Mapping[Atom | Effect, int], busy: Mapping[str, int], created: set[str]
    ) -> None:
        existing, entries = [], []
        for what, place in places.items():
            if isinstance(what, Effect) or len(what) > 2:
                continue
            if what[0] == EXISTS:
                existing.append((self._node[what[1]], place))
            else:
                column = self.features.index(what[0])
                entries += [(row, column, place) for row in self._rows(what)]
        column = self.features.index(BUSY)
        entries += [(self._node[player], column, place) for player, place in busy.items()]
        # Play cannot create the objects of some slots; their nodes stay zero.
        never = {i for name, i in self._node.items() if name in created} - {i for i, _ in existing}
        self._fixed[list(never)] = 0
        self._existing = np.array(existing, dtype=np.intp).reshape(-1, 2).T
        self._entries = np.array(entries, dtype=np.intp).reshape(-1, 3).T

    def _read_links(self, links: Sequence[Link], size: int) -> None:
        """Store the possible edges and the positions of their truth and counters."""
        # `graph` appends a 1 and a 0 to each vector: the truth of static edges, and the value of
        # missing counters. Then one indexing operation reads all edges.
        relation = {name: i for i, name in enumerate(self.relations)}
        most = self.counters
        self._places = np.array([link.place for link in links], dtype=np.intp)
        self._links = np.array(
            [(relation[x.relation], self._node[x.subject], self._node[x.object]) for x in links],
            dtype=np.int64,
        ).reshape(-1, 3)
        self._counters = np.array(
            [[*x.counters, *[size + 1] * (most - len(x.counters))] for x in links], dtype=np.intp
        ).reshape(-1, most)

    def graph(self, vector: npt.NDArray[np.float32]) -> Graph:
        """Return the graph of a vector."""
        numbers = np.append(vector, np.array([1, 0], dtype=np.float32))
        nodes = self._fixed.copy()
        rows, places = self._existing
        nodes[rows] *= numbers[places, np.newaxis]
        rows, columns, places = self._entries
        nodes[rows, columns] = numbers[places]
        found = np.flatnonzero(numbers[self._places])
        edges = self._links[found]
        # A static relation ends when one of its objects is deleted.
        if len(self._existing[0]):
            there = (nodes[edges[:, 1], 0] > 0) & (nodes[edges[:, 2], 0] > 0)
            found, edges = found[there], edges[there]
        return Graph(nodes, edges, numbers[self._counters[found]])


def _relations(task: GroundTask) -> Iterator[str]:
    """Yield the relations of the domain, so that all its tasks number relations alike."""
    for predicate, types in task.table.types.items():
        yield from (name for name, _ in _named(predicate, types[1:]))
    for schema in task.schemas:
        for i, effect in enumerate(schema.all_effects):
            others = effect.variables[1:] or effect.variables
            yield from (name for name, _ in _named(f"{schema.name}.{i}", others))


def _size(effect: EffectDef) -> int:
    """Return the number of an effect's counters."""
    return 1 if isinstance(effect, InstantEffect) else 1 + sum(map(_size, effect.sfx))


def links_of(what: Atom | Effect, place: int) -> Iterator[Link]:
    """Yield the edges of a fact or effect: from its first object to each other, or to itself."""
    if isinstance(what, Effect):
        action, index, arguments = what.label
        counters = range(place + 1, place + 1 + what.size)
        for name, other in _named(f"{action}.{index}", arguments[1:] or arguments):
            yield Link(place, name, arguments[0], other, counters)
    elif len(what) > 2:
        predicate, first, *others = what
        for name, other in _named(predicate, others):
            yield Link(place, name, first, other)


def _named(name: str, others: Sequence[str]) -> Iterator[tuple[str, str]]:
    if len(others) == 1:
        yield name, others[0]
    else:
        yield from ((f"{name}[{i}]", other) for i, other in enumerate(others, start=1))
