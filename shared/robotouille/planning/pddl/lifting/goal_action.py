"""The goal as an action without cost: its parameters are the goal's variables."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

from robotouille.planning.pddl.lifting.lifted import THERE, Lifted
from robotouille.planning.pddl.syntax import Literal, PddlAction, PddlEffect, Term, Variable

__all__ = ["DONE", "candidate_facts", "candidate_predicates", "finish"]

DONE: Term = ("~done",)


def finish(
    lifted: Lifted, parameters: tuple[Variable, ...] = (), condition: tuple[Literal, ...] = ()
) -> PddlAction:
    """Claims that some choice of objects makes all predicates of the goal true.

    `condition`, over `parameters`, says when that may be claimed.
    """
    goal = lifted.world.goal
    variables: tuple[Variable, ...] = tuple((_name(i), _type(lifted, i)) for i in goal.variables)
    chosen = [((_may_be(i), _name(i)), True) for i in goal.variables]
    wanted = [((t.predicate, *map(_name, t.ids)), True) for t in goal.terms]
    different = [
        (("=", _name(one.id), _name(other.id)), False)
        for one, other in combinations(goal.variables.values(), 2)
        if one.kind == other.kind
    ]
    there = [((THERE, name), True) for name in _must_exist(lifted)]
    literals: tuple[Literal, ...] = (*condition, *wanted, *chosen, *there, *different)
    return PddlAction(
        "~finish", (*parameters, *variables), literals, (PddlEffect(((DONE, True),)),)
    )


def candidate_predicates(lifted: Lifted) -> dict[str, tuple[str, ...]]:
    """For each variable of the goal, a predicate of the objects it may stand for."""
    return {_may_be(i): (_type(lifted, i),) for i in lifted.world.goal.variables}


def candidate_facts(lifted: Lifted) -> Iterator[Term]:
    """Which objects these are."""
    goal = lifted.world.goal
    for identifier in goal.variables:
        kind = _type(lifted, identifier)
        for name in goal.candidates(identifier):
            if f"={lifted.world.thing(name).type}" == kind:
                yield (_may_be(identifier), name)


def _must_exist(lifted: Lifted) -> list[str]:
    """A fact that never changes is about an object only while that exists."""
    static = lifted.world.table.static_predicates
    terms = [t for t in lifted.world.goal.terms if t.predicate in static]
    names = dict.fromkeys(i for term in terms for i in term.ids)
    return [_name(i) for i in names if _type(lifted, i).removeprefix("=") in lifted.transient]


def _name(identifier: int | str) -> str:
    return f"?~g{identifier}"


def _may_be(identifier: int | str) -> str:
    return f"~goal-{identifier}"


def _type(lifted: Lifted, identifier: int | str) -> str:
    for term in lifted.world.goal.terms:
        if identifier in term.ids:
            return lifted.predicates[term.predicate][term.ids.index(identifier)]
    raise KeyError(identifier)
