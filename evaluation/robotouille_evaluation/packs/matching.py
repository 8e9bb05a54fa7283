"""Which tasks of two packs are the same, whatever their names and numbers, and what goals mean.

Goals are compared by what they ask, not by how they number their objects.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from difflib import SequenceMatcher
from itertools import product
from typing import Any

from robotouille.domain.schema import GoalTerm, ProblemFile
from robotouille_evaluation.packs.pack import Pack, PackTask

__all__ = ["goal_conditions", "match_tasks", "same_goal"]

NEAR = 0.6
"""How alike two names have to be at least, 1 being the same."""


def match_tasks(a: Pack, b: Pack) -> list[tuple[PackTask | None, PackTask | None]]:
    """Each task of `a` with its like in `b`, then those of `b` that are left over.

    Tasks are paired within a data set, those with the most similar names first.
    """
    pairs: dict[str, PackTask] = {}
    taken: set[str] = set()
    rows = sorted(
        ((_likeness(one, two), one, two) for one, two in product(a.tasks, b.tasks)),
        key=lambda row: -row[0],
    )
    for likeness, one, two in rows:
        if likeness >= NEAR and one.name not in pairs and two.name not in taken:
            pairs[one.name] = two
            taken.add(two.name)
    both: list[tuple[PackTask | None, PackTask | None]] = [
        (task, pairs.get(task.name)) for task in a.tasks
    ]
    return both + [(None, task) for task in b.tasks if task.name not in taken]


def _likeness(a: PackTask, b: PackTask) -> float:
    if a.dataset != b.dataset:
        return 0.0
    return SequenceMatcher(None, _dish(a.name), _dish(b.name), autojunk=False).ratio()


def _dish(name: str) -> str:
    """A task's name without folder and number."""
    return re.sub(r"^[\d.]+_", "", name.rpartition("/")[2])


def goal_conditions(problem: ProblemFile) -> list[str]:
    """The goal's conditions: `atop(lettuce1, tomato1)`, with numbers for objects of a kind."""
    names = _names(problem.goal)
    return [f"{term.predicate}({', '.join(names[i] for i in term.ids)})" for term in problem.goal]


def _names(goal: Sequence[GoalTerm]) -> dict[Any, str]:
    kinds = _kinds(goal)
    repeated = Counter(kinds.values())
    counts: Counter[str] = Counter()
    names = {}
    for id_, kind in kinds.items():
        counts[kind] += 1
        names[id_] = f"{kind}{counts[kind]}" if repeated[kind] > 1 else kind
    return names


def _kinds(goal: Sequence[GoalTerm]) -> dict[Any, str]:
    kinds: dict[Any, str] = {}
    for term in goal:
        for id_, kind in zip(term.ids, term.args, strict=True):
            kinds.setdefault(id_, kind)
    return kinds


def same_goal(a: Sequence[GoalTerm], b: Sequence[GoalTerm]) -> bool:
    """Whether two goals ask the same of the same number of objects.

    Objects are told apart by the conditions that they and their neighbours occur in, so far as
    the goal goes; goals here are stacks and soups, for which that is enough.
    """
    return _shape(a) == _shape(b)


def _shape(goal: Sequence[GoalTerm]) -> Counter[Any]:
    looks: dict[Any, Any] = dict(_kinds(goal))
    terms = {(term.predicate, term.ids) for term in goal}
    for _ in looks:
        looks = {id_: hash((look, _around(id_, terms, looks))) for id_, look in looks.items()}
    return Counter((predicate, tuple(looks[i] for i in ids)) for predicate, ids in terms)


def _around(id_: Any, terms: set[tuple[str, tuple[Any, ...]]], looks: dict[Any, Any]) -> Any:
    around = Counter(
        (predicate, ids.index(id_), tuple(looks[i] for i in ids))
        for predicate, ids in terms
        if id_ in ids
    )
    return frozenset(around.items())
