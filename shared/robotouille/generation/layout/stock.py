"""What can be added to a kitchen: the kinds of its domain, and what objects of a kind are like."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache

from robotouille.domain.checks.derived import fluents
from robotouille.domain.files import read_model
from robotouille.domain.loading import task_names
from robotouille.domain.schema import ObjectDef, ProblemFile
from robotouille.domain.task import Task
from robotouille.generation.layout.type_roles import Roles
from robotouille.generation.rng import SeededRng
from robotouille.resources import data_folder

__all__ = ["Stock"]

RARELY = 1 / 8
"""How likely an irrelevant item is a vessel."""

Traits = dict[tuple[str, str], tuple[str, ...]]
"""For a type and a kind, the predicates that all its objects have in problem files."""

Choice = tuple[str, str]
"""A type and a kind of it."""


class Stock:
    """The kinds of stations and items that a task's domain has.

    A domain file need not list its kinds; then they are those of the task. Predicates (that an
    item can be cut, say) are what a kind's objects have in common in the task, or in the shipped
    tasks of the domain where the task has none of the kind. Of the shipped ones, those that begin
    prepared (cooked, say) count only where all do.
    """

    def __init__(self, task: Task, roles: Roles) -> None:
        self._own = _traits([task.problem])
        self._shipped = _shipped_traits(task.domain.name, fluents(task.domain))
        self._known = {p.name: p.param_types for p in task.domain.predicate_defs}
        plain = [t for t in roles.placeable if t not in roles.vessels]
        self.stations = self._choices(task, roles.stations)
        self._plain = self._choices(task, plain)
        self._vessels = self._choices(task, roles.vessels)

    def _choices(self, task: Task, types: Iterable[str]) -> list[Choice]:
        return [(t, kind) for t in types for kind in self._kinds(task, t)]

    def _kinds(self, task: Task, type_: str) -> tuple[str, ...]:
        placed = dict.fromkeys(kind for t, kind in self._own if t == type_)
        return task.domain.kinds.get(type_) or tuple(placed)

    @property
    def has_items(self) -> bool:
        return bool(self._plain or self._vessels)

    def station(self, rng: SeededRng) -> tuple[str, ObjectDef]:
        """The type of an irrelevant station, and the station itself, nowhere in particular."""
        return self._made(rng.one_of(self.stations))

    def item(self, rng: SeededRng) -> tuple[str, ObjectDef]:
        """The same for something that stands on stations; rarely a vessel."""
        rare = rng.happens(RARELY)
        pool = self._vessels if (rare and self._vessels) or not self._plain else self._plain
        return self._made(rng.one_of(pool))

    def _made(self, choice: Choice) -> tuple[str, ObjectDef]:
        type_, kind = choice
        traits = self._own.get(choice, self._shipped.get(choice, ()))
        fitting = tuple(name for name in traits if self._known.get(name) == (type_,))
        return type_, ObjectDef(name=kind, x=0, y=0, predicates=fitting)


def _traits(problems: Iterable[ProblemFile], prepared: frozenset[str] = frozenset()) -> Traits:
    """What the objects of each kind have in common.

    Args:
        prepared: Objects with one of these predicates count only for kinds of which all have one.
    """
    common: Traits = {}
    common_prepared: Traits = {}
    for problem in problems:
        for type_, things in problem.objects.items():
            for thing in things:
                found = common if prepared.isdisjoint(thing.predicates) else common_prepared
                before = found.setdefault((type_, thing.name), thing.predicates)
                found[type_, thing.name] = tuple(p for p in before if p in thing.predicates)
    return common_prepared | common


@cache
def _shipped_traits(domain: str, changeable: frozenset[str]) -> Traits:
    """The same of all shipped objects as they are before any action has changed them."""
    return _traits(_shipped_problems(domain), changeable)


def _shipped_problems(domain: str) -> Iterator[ProblemFile]:
    """The problems of a domain that were written, not generated."""
    folder = data_folder("problems")
    for name in task_names():
        problem = read_model(folder / f"{name}.json", ProblemFile)
        if (problem.domain or "robotouille") == domain and problem.provenance is None:
            yield problem
