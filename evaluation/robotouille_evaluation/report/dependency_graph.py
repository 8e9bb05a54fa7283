"""Dependency graph of a task, derived from a plan (paper, appendix "Task Dependency Graphs").

Nodes are the objects that a recipe starts with and the work on them. An edge leads from an object
or work to the work that needs it. Walking and carrying are not part of a recipe and are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from robotouille.html_report.figures import (
    COLOURS,
    FAINT,
    INK,
    SOFT,
    ReportFigure,
    draw_figure,
    short_label,
)
from robotouille.planning import Plan
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import World
from robotouille_evaluation.metrics.asynchrony import is_asynchronous, is_work

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Node:
    """Object, or work on objects. Asynchronous work continues without a player."""

    label: str
    work: bool = True
    asynchronous: bool = False


@dataclass(frozen=True, slots=True)
class DependencyGraph:
    """Nodes, and edges between their indices, each from a need to the work that needs it."""

    title: str
    nodes: tuple[Node, ...]
    edges: tuple[tuple[int, int], ...]


def dependency_graph(world: World, plan: Plan) -> DependencyGraph:
    """Return the graph of a task's work, with nodes in the order of the plan."""
    building = _Building(world)
    for joint in plan:
        for action in joint:
            if is_work(action):
                building.add(action)
    goal = world.task.goal_description
    return DependencyGraph(goal, tuple(building.nodes), tuple(sorted(building.edges)))


class _Building:
    """Graph under construction.

    `_latest` maps an object to its last node, `_work` a node to its action name and objects.
    """

    def __init__(self, world: World) -> None:
        domain = world.task.domain
        self._world = world
        self._places = {*domain.station_types, *domain.player_types}
        self._latest: dict[str, int] = {}
        self._work: dict[int, tuple[str, tuple[str, ...]]] = {}
        self.nodes: list[Node] = []
        self.edges: set[tuple[int, int]] = set()

    def add(self, action: GroundAction) -> None:
        things = [a for a in action.arguments if self._world.thing(a).type not in self._places]
        work = (action.name, tuple(things))
        if not things or self._work.get(self._latest.get(things[0], -1)) == work:
            return  # Three cuts are one node.
        before = [self._node_of(thing) for thing in things]
        label = f"{action.name} {self._kind(things[0])}"
        number = len(self.nodes)
        self.nodes.append(Node(label, asynchronous=is_asynchronous(action)))
        self.edges |= {(each, number) for each in before}
        self._latest.update(dict.fromkeys(things, number))
        self._work[number] = work

    def _node_of(self, thing: str) -> int:
        if thing not in self._latest:
            made_by = self._maker(thing)
            if made_by is not None:
                return made_by
            self._latest[thing] = len(self.nodes)
            self.nodes.append(Node(self._kind(thing), work=False))
        return self._latest[thing]

    def _maker(self, thing: str) -> int | None:
        """Return the last asynchronous work, for an object that did not exist at the start."""
        if any(thing == placed.name for placed in self._world.placed):
            return None
        late = [i for i, node in enumerate(self.nodes) if node.asynchronous]
        return late[-1] if late else None

    def _kind(self, thing: str) -> str:
        return self._world.thing(thing).kind


def draw_graph(name: str, graph: DependencyGraph) -> ReportFigure:
    """Draw the graph from left to right. Asynchronous work has a dashed border."""
    layers, rows = _layers(graph), _rows(graph)
    width, height = 1 + max(layers, default=0), 1 + max(rows.values(), default=0)
    places = [(layer, rows[number]) for number, layer in enumerate(layers)]

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.set_axis_off()
        _draw(axes, graph, places)
        axes.set_xlim(-0.5, width - 0.5)
        axes.set_ylim(height - 0.5, -0.5)

    return draw_figure(name, graph.title, (max(3.2, 1.12 * width), max(1.3, 0.5 * height)), draw)


def _layers(graph: DependencyGraph) -> list[int]:
    """Return the column of each node, as close as possible to the work that needs it."""
    left = [0] * len(graph.nodes)
    for a, b in sorted(graph.edges, key=lambda edge: -edge[1]):
        left[a] = max(left[a], left[b] + 1)
    return [max(left) - each for each in left] if left else []


def _rows(graph: DependencyGraph) -> dict[int, float]:
    """Return the row of each node: leaves below each other, and work centred on its needs."""
    before: dict[int, list[int]] = {}
    for a, b in sorted(graph.edges):
        before.setdefault(b, []).append(a)
    rows: dict[int, float] = {}
    lines = 0

    def place(number: int) -> None:
        nonlocal lines
        needed = [each for each in before.get(number, ()) if each not in rows]
        for each in sorted(needed, key=lambda each: (not graph.nodes[each].work, each)):
            if each not in rows:
                place(each)
        if needed:
            rows[number] = sum(rows[each] for each in needed) / len(needed)
        else:
            rows[number] = float(lines)
            lines += 1

    needed_by = {a for a, _ in graph.edges}
    for number in range(len(graph.nodes)):
        if number not in needed_by:
            place(number)
    return rows


def _draw(axes: Axes, graph: DependencyGraph, places: Sequence[tuple[float, float]]) -> None:
    for a, b in graph.edges:
        begin, end = (places[a][0] + 0.4, places[a][1]), (places[b][0] - 0.4, places[b][1])
        axes.annotate("", end, begin,
                      arrowprops={"arrowstyle": "->", "color": SOFT, "shrinkA": 0, "shrinkB": 0,
                                  "linewidth": 0.9})  # fmt: skip
    for number, node in enumerate(graph.nodes):
        colour = COLOURS[1] if node.asynchronous else COLOURS[0] if node.work else FAINT
        axes.text(*places[number], short_label(node.label, 30).replace(" ", "\n"),
                  ha="center", va="center", fontsize=7.5, color=INK, linespacing=1.0,
                  bbox={"boxstyle": "round,pad=0.35" if node.work else "square,pad=0.3",
                        "facecolor": "none", "edgecolor": colour, "linewidth": 1.2,
                        "linestyle": "--" if node.asynchronous else "-"})  # fmt: skip
