"""Observations as graphs."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from gymnasium.spaces import GraphInstance

from robotouille.envs.egocentric import turned
from robotouille.envs.layout import Layout, Said
from robotouille.envs.observers.observer import Observer, order_of
from robotouille.envs.play import Play
from robotouille.envs.rules import Perspective
from robotouille.envs.views import ObservationView
from robotouille.world.arrays.goal_graph import goal_graph
from robotouille.world.arrays.graph import Graph


class GraphObserver(Observer):
    """Observer of states as graphs, whose nodes are the objects and the things in the goal."""

    def __init__(self, layout: Layout) -> None:
        super().__init__(layout)
        self._goals: dict[ObservationView, Graph] = {}

    def space(self) -> spaces.Graph:
        encoding = self.layout.first.world.encoding
        high = max(self.layout.sizes.high, len(encoding.relations))
        nodes = spaces.Box(-1.0, high, (len(self.layout.features),), np.float32)
        return spaces.Graph(nodes, spaces.Box(-1.0, high, (1 + encoding.counters,), np.float32))

    def observe(self, play: Play, seat: int | None = None, said: Said = ()) -> GraphInstance:
        graph = self._marked(play, seat, said)
        if seat is not None and self.layout.egocentric:
            graph = turned(graph, order_of(play), seat)
        if self.layout.rules.goal:
            graph = _with_goal(graph, self._goal_of(play.view))
        relations = graph.edges[:, :1].astype(np.float32)
        return GraphInstance(
            graph.nodes, np.hstack([relations, graph.counters]), graph.edges[:, 1:]
        )

    def _marked(self, play: Play, seat: int | None, said: Said) -> Graph:
        """Return the graph of what an agent sees, with the features of agents and messages."""
        layout, order = self.layout, order_of(play)
        graph = self._sight.visible(play, seat).graph()
        own = layout.perspective is not Perspective.SHARED
        limited, tokens = layout.rules.sight is not None, len(layout.messages)
        nodes = np.pad(graph.nodes, ((0, 0), (0, own + limited + tokens)))
        seen = self._sight.things(play, seat, layout.objects)
        if seen is not None:
            nodes[:, graph.nodes.shape[1] + own] = seen[: len(nodes)]
        if tokens:
            nodes[order, -tokens:] = layout.spoken(said)
        if seat is not None and own:
            nodes[order[seat], graph.nodes.shape[1]] = 1
        return graph._replace(nodes=nodes)

    def _goal_of(self, view: ObservationView) -> Graph:
        found = self._goals.get(view)
        if found is None:
            found = self._goals[view] = goal_graph(view.world, view.world.encoding)
        return found


def _with_goal(graph: Graph, goal: Graph) -> Graph:
    """Return a graph with the nodes of a goal at the end, and a feature that marks them."""
    count, width = graph.nodes.shape
    nodes = np.pad(graph.nodes, ((0, len(goal.nodes)), (0, 1)))
    nodes[count:, : goal.nodes.shape[1]] = goal.nodes
    nodes[count:, width] = 1
    edges = np.concatenate([graph.edges, goal.edges + np.array([0, count, count])])
    return Graph(nodes, edges, np.concatenate([graph.counters, goal.counters]))
