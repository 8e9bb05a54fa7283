"""How two packs differ, task by task: goal, layout, objects, words, optimum and budget."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from robotouille.domain.files import parse_json, validate
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.errors import RobotouilleError
from robotouille_evaluation.packs.matching import goal_conditions, match_tasks, same_goal
from robotouille_evaluation.packs.pack import Pack, PackInstance, PackTask

__all__ = ["Difference", "PackDifferences", "TaskDifferences", "compare_packs"]


SHOWN = ("station", "item", "container")
"""The types of objects that are listed by kind."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One respect in which two things differ, and what each has; empty for nothing."""

    aspect: str
    a: str
    b: str


@dataclass(frozen=True, slots=True)
class TaskDifferences:
    """A task of one pack and its like in the other; None where there is none."""

    a: str | None
    b: str | None
    differences: tuple[Difference, ...] = ()


@dataclass(frozen=True, slots=True)
class PackDifferences:
    """How two packs differ: as packs, in the words of their domains, and task by task."""

    a: str
    b: str
    overall: tuple[Difference, ...]
    wording: tuple[Difference, ...]
    tasks: tuple[TaskDifferences, ...]

    @property
    def none(self) -> bool:
        """Whether they do not differ at all."""
        alone = any(task.a is None or task.b is None for task in self.tasks)
        found = any(task.differences for task in self.tasks)
        return not (self.overall or self.wording or alone or found)


def compare_packs(a: Pack, b: Pack) -> PackDifferences:
    """How pack `b` differs from pack `a`."""
    return PackDifferences(
        f"{a.name} {a.version}",
        f"{b.name} {b.version}",
        tuple(_unequal(_overall(a), _overall(b))),
        tuple(_unequal(_words(a), _words(b))),
        tuple(_task(a, one, b, two) for one, two in match_tasks(a, b)),
    )


def _unequal(a: dict[str, str], b: dict[str, str]) -> Iterator[Difference]:
    for aspect in {**a, **b}:
        one, two = a.get(aspect, ""), b.get(aspect, "")
        if one != two:
            yield Difference(aspect, one, two)


def _overall(pack: Pack) -> dict[str, str]:
    return {
        "tasks": str(len(pack.tasks)),
        "instances": _counted(instance.kind for instance in pack.instances),
        "prompts": str(len(pack.prompts)),
        "examples": str(len(pack.examples)),
        "experiments": str(len(pack.experiments)),
    }


def _words(pack: Pack) -> dict[str, str]:
    """What the domain says of each predicate and action."""
    domain = validate(parse_json(pack.domain, pack.name), DomainFile, pack.name)
    words = {
        f"{predicate.name} of argument {which}": text
        for predicate in domain.predicate_defs
        for which, text in predicate.language_descriptors.items()
    }
    actions = {
        f"action {action.name}": action.language_description for action in domain.action_defs
    }
    return {**words, **actions}


def _task(a: Pack, one: PackTask | None, b: Pack, two: PackTask | None) -> TaskDifferences:
    if one is None or two is None:
        return TaskDifferences(one.name if one else None, two.name if two else None)
    mine, other = _problem(one), _problem(two)
    aspects = _aspects(a, one, mine), _aspects(b, two, other)
    if not same_goal(mine.goal, other.goal):
        for aspect, problem, against in zip(aspects, (mine, other), (other, mine), strict=True):
            aspect["goal"] = _conditions(problem, against)
        if aspects[0]["goal"] == aspects[1]["goal"]:
            for aspect, problem in zip(aspects, (mine, other), strict=True):
                aspect["goal"] = ", ".join(goal_conditions(problem))
    return TaskDifferences(one.name, two.name, tuple(_unequal(*aspects)))


def _problem(task: PackTask) -> ProblemFile:
    return validate(parse_json(task.problem, task.name), ProblemFile, task.name)


def _aspects(pack: Pack, task: PackTask, problem: ProblemFile) -> dict[str, str]:
    instances = pack.instances_of([task.name])
    return {
        "words": problem.goal_description,
        "grid": f"{problem.width} × {problem.height}",
        **{f"{kind}s": _objects(problem, kind) for kind in SHOWN},
        "players": _players(problem),
        "not on tables": _places(problem),
        "optimum": _optimum(task, instances),
        "budget": _budget(pack, instances),
    }


def _conditions(problem: ProblemFile, other: ProblemFile) -> str:
    """The conditions that the other goal has not."""
    own = Counter(goal_conditions(problem)) - Counter(goal_conditions(other))
    return ", ".join(own.elements())


def _objects(problem: ProblemFile, kind: str) -> str:
    """Kinds with their number; in brackets the predicates that they are given."""
    return _counted(
        f"{thing.name} [{', '.join(sorted(thing.predicates))}]" if thing.predicates else thing.name
        for thing in problem.objects.get(kind, ())
    )


def _players(problem: ProblemFile) -> str:
    """How many may play."""
    listed = len(problem.objects.get("player", ()))
    return " or ".join(map(str, problem.seats or (listed,)))


def _places(problem: ProblemFile) -> str:
    """What does not begin on a table: where a table is makes no difference to a plan's length."""
    stations = {(thing.x, thing.y): thing.name for thing in problem.objects.get("station", ())}
    things = [
        f"{thing.name} on {place}"
        for kind in ("item", "container")
        for thing in problem.objects.get(kind, ())
        if (place := stations.get((thing.x, thing.y), "no station")) != "table"
    ]
    return _counted(things)


def _counted(words: Iterable[str]) -> str:
    counts = Counter(words)
    return ", ".join(
        word if count == 1 else f"{count} {word}" for word, count in sorted(counts.items())
    )


def _optimum(task: PackTask, instances: Sequence[PackInstance]) -> str:
    if task.optimal is None:
        return ""
    spread = sorted(
        steps for i in instances if i.kind == "free" and (steps := i.optimal()) is not None
    )
    if not spread:
        return str(task.optimal)
    return f"{task.optimal} (free instances {spread[0]} to {spread[-1]})"


def _budget(pack: Pack, instances: Sequence[PackInstance]) -> str:
    try:
        return str(pack.budget(instances[0], "published").max_steps)
    except RobotouilleError:
        return ""
