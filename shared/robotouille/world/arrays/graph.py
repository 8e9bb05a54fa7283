"""States as graphs: objects are nodes, relations edges (world.md, "As arrays")."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robotouille.domain.schema import Creation, Deletion, EffectDef
from robotouille.world.grounding.atoms import EXISTS
from robotouille.world.grounding.effects import Effect
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, Object

__all__ = ["Graph", "GraphLayout"]

EXISTING, BUSY = "exists", "busy"


class Graph(NamedTuple):
    """A state as a graph.

    `nodes` has a row for each of `Encoding.objects`, with the numbers that `Encoding.features`
    names. `edges` has a row for each relation that holds: its place in `Encoding.relations`, and
    the nodes of its subject and its object. `counters` has a row for each edge: an active effect's
    counters, else zeros.
    """

    nodes: npt.NDArray[np.float32]
    edges: npt.NDArray[np.int64]
    counters: npt.NDArray[np.float32]


class Link(NamedTuple):
    """An edge that there may be: the number of the vector that says so, and its counters'."""

    place: int
    relation: str
    subject: str
    object: str
    counters: range = range(0)


class GraphLayout:
    """Which numbers of a vector are which node's features, and which of them are edges.

    Args:
        task: The task.
        objects: Those that are nodes.
        places: Where each atom and effect is in a vector.
        busy: Where it is for how long a player is busy.
        size: The length of a vector.
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
        links = [link for atom in static for link in _links(atom, size)]
        links += [link for what, place in places.items() for link in _links(what, place)]
        self.relations = tuple(_relations(task))
        self.counters = max((_size(e) for s in task.schemas for e in s.definition.sfx), default=0)
        self._read_nodes(places, busy, {thing.name for thing in objects if thing.tile is None})
        self._read_links(links, size)

    def _fixed_nodes(
        self, objects: Sequence[Object], static: Sequence[Atom]
    ) -> npt.NDArray[np.float32]:
        """What is always so of what exists."""
        fixed = np.zeros((len(objects), len(self.features)), dtype=np.float32)
        for row, thing in enumerate(objects):
            fixed[row, [0, self.features.index(thing.type)]] = 1
        for atom in static:
            fixed[self._rows(atom), self.features.index(atom[0])] = 1
        return fixed

    def _rows(self, atom: Atom) -> list[int]:
        """Which nodes a fact of at most one object is about."""
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
        never = {i for name, i in self._node.items() if name in created} - {i for i, _ in existing}
        self._fixed[list(never)] = 0
        self._existing = np.array(existing, dtype=np.intp).reshape(-1, 2).T
        self._entries = np.array(entries, dtype=np.intp).reshape(-1, 3).T

    def _read_links(self, links: Sequence[Link], size: int) -> None:
        """Static edges have their truth behind the vector, where a 1 is put; no counter a 0."""
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
        """The graph that says what a vector says."""
        numbers = np.append(vector, np.array([1, 0], dtype=np.float32))
        nodes = self._fixed.copy()
        rows, places = self._existing
        nodes[rows] *= numbers[places, np.newaxis]
        rows, columns, places = self._entries
        nodes[rows, columns] = numbers[places]
        found = np.flatnonzero(numbers[self._places])
        edges = self._links[found]
        if len(self._existing[0]):
            there = (nodes[edges[:, 1], 0] > 0) & (nodes[edges[:, 2], 0] > 0)
            found, edges = found[there], edges[there]
        return Graph(nodes, edges, numbers[self._counters[found]])


def _relations(task: GroundTask) -> Iterator[str]:
    """Those that the domain knows: so all tasks of a domain number them alike."""
    for predicate, types in task.table.types.items():
        yield from (name for name, _ in _named(predicate, types[1:]))
    for schema in task.schemas:
        for i, effect in enumerate(schema.all_effects):
            others = effect.variables[1:] or effect.variables
            yield from (name for name, _ in _named(f"{schema.name}.{i}", others))


def _size(effect: EffectDef) -> int:
    """How many counters an effect has."""
    return 1 if isinstance(effect, Creation | Deletion) else 1 + sum(map(_size, effect.sfx))


def _links(what: Atom | Effect, place: int) -> Iterator[Link]:
    """The edges of a fact or an effect: from its first object to each other one, or to itself."""
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
