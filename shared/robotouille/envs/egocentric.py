"""Vectors and graphs with an agent's own player in the place of the first one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from robotouille.envs.views import ObservationView
from robotouille.world.arrays.graph import Graph
from robotouille.world.arrays.seat_columns import for_later_seat

Places = npt.NDArray[np.intp]


def own_columns(view: ObservationView) -> tuple[str, ...]:
    """Return the columns of an agent's own vector, in which the first player is the agent.

    Players that a counter divides have other facts, so the columns are those of all agents.
    """
    columns, players = view.world.encoding.columns, view.world.players
    seats = range(len(players))
    return tuple(dict.fromkeys(c for i in seats for c in for_later_seat(columns, players, -i)))


def places(view: ObservationView, size: int) -> tuple[Places, ...]:
    """Return, for each seat, the places in a padded vector of an agent's own columns."""
    columns, players = view.world.encoding.columns, view.world.players
    place = {name: i for i, name in enumerate(columns)}
    own = own_columns(view)
    nothing = view.sizes.vector  # The place of the zero after a padded vector.
    found = np.full((len(players), size), nothing, dtype=np.intp)
    for seat in range(len(players)):
        sources = for_later_seat(own, players, seat)
        found[seat, : len(own)] = [place.get(column, nothing) for column in sources]
    return tuple(found)


def turned(graph: Graph, order: Sequence[int], seat: int) -> Graph:
    """Return a graph in which the agent's player is in the place of the first one."""
    old = np.arange(len(graph.nodes))
    old[order] = [*order[seat:], *order[:seat]]
    new = np.argsort(old)
    edges = graph.edges.copy()
    edges[:, 1:] = new[edges[:, 1:]]
    return Graph(graph.nodes[old], edges, graph.counters)
