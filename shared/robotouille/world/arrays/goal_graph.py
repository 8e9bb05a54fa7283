"""The goal of a task as nodes and edges of a graph (docs/train.md)."""

from __future__ import annotations

import numpy as np

from robotouille.domain.schema import GoalTerm
from robotouille.world.arrays.encoding import Encoding
from robotouille.world.arrays.graph import Graph, links_of
from robotouille.world.grounding.goal import Goal, Variable
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom


def goal_graph(task: GroundTask, encoding: Encoding) -> Graph:
    """Return a node for each thing that a task's goal needs, in the format of `Encoding.graph`.

    A node has the type of the thing, the features that all objects of its kind always have, and the
    conditions of the goal about it alone. Conditions about several things are edges.
    """
    goal: Goal = task.goal
    node = {identifier: i for i, identifier in enumerate(goal.variables)}
    feature = {name: i for i, name in enumerate(encoding.features)}
    relation = {name: i for i, name in enumerate(encoding.relations)}
    nodes = np.zeros((len(node), len(feature)), dtype=np.float32)
    for identifier, variable in goal.variables.items():
        nodes[node[identifier], [feature[name] for name in _kind_features(task, variable)]] = 1
    edges = []
    for term in goal.terms:
        for identifier, type_ in zip(term.ids, task.table.types[term.predicate], strict=True):
            nodes[node[identifier], feature[type_]] = 1
        if len(term.ids) == 1:
            nodes[node[term.ids[0]], feature[term.predicate]] = 1
        edges += [
            (relation[link.relation], int(link.subject), int(link.object))
            for link in links_of(_numbered(term, node), 0)
        ]
    return Graph(
        nodes,
        np.array(edges, dtype=np.int64).reshape(-1, 3),
        np.zeros((len(edges), encoding.counters), dtype=np.float32),
    )


def _numbered(term: GoalTerm, node: dict[int | str, int]) -> Atom:
    """Return a condition with the numbers of nodes as the names of its objects."""
    return (term.predicate, *(str(node[identifier]) for identifier in term.ids))


def _kind_features(task: GroundTask, variable: Variable) -> set[str]:
    """Return the facts that always hold of all objects of a variable's kind."""
    things = [
        thing
        for thing in task.placed
        if variable.kind in (thing.kind, thing.type) and variable.fixed in (None, thing.name)
    ]
    fixed = [
        {atom[0] for atom in task.table.static if atom[1:] == (thing.name,)} for thing in things
    ]
    return set.intersection(*fixed) if fixed else set()
