"""Differences between two packs: goals, layouts, objects, words, optima and budgets."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from itertools import product
from typing import Any

from rich.table import Table
from rich.text import Text

from robotouille.domain.json_files import parse_json, validate
from robotouille.domain.schema import DomainFile, GoalTerm, ProblemFile
from robotouille.errors import RobotouilleError
from robotouille.terminal import printable
from robotouille_evaluation.packs.pack import Pack, PackInstance, PackTask

NEAR = 0.6
"""Least similarity of paired names; 1 means equal."""
MAX_PAIRS, MAX_NAME, MAX_ROUNDS = 10_000, 100, 100
"""Pairs of names that are compared, characters of a name, and rounds of a comparison of goals.
Packs may come from anyone."""


def match_tasks(a: Pack, b: Pack) -> list[tuple[PackTask | None, PackTask | None]]:
    """Return each task of `a` with its counterpart in `b`, then the other tasks of `b`.

    Tasks are paired within a data set, the most similar names first. In packs of very many tasks,
    only equal names are paired.
    """
    pairs: dict[str, PackTask] = {}
    taken: set[str] = set()
    # Greedy: the most similar names are paired first.
    rows = sorted(
        ((_similarity(one, two), one, two) for one, two in _candidates(a, b)),
        key=lambda row: -row[0],
    )
    for similarity, one, two in rows:
        if similarity >= NEAR and one.name not in pairs and two.name not in taken:
            pairs[one.name] = two
            taken.add(two.name)
    both: list[tuple[PackTask | None, PackTask | None]] = [
        (task, pairs.get(task.name)) for task in a.tasks
    ]
    return both + [(None, task) for task in b.tasks if task.name not in taken]


def _candidates(a: Pack, b: Pack) -> Iterator[tuple[PackTask, PackTask]]:
    """Yield the pairs of tasks whose names are compared."""
    alike = {(task.dataset, task.name): task for task in b.tasks}
    if len(a.tasks) * len(b.tasks) > MAX_PAIRS:
        found = ((task, alike.get((task.dataset, task.name))) for task in a.tasks)
        yield from ((one, two) for one, two in found if two is not None)
        return
    yield from ((one, two) for one, two in product(a.tasks, b.tasks) if one.dataset == two.dataset)


def _similarity(a: PackTask, b: PackTask) -> float:
    one, two = _dish(a.name), _dish(b.name)
    if one == two:
        return 1.0
    return SequenceMatcher(None, one[:MAX_NAME], two[:MAX_NAME], autojunk=False).ratio()


def _dish(name: str) -> str:
    """Return a task's name without folder and number."""
    return re.sub(r"^[\d.]+_", "", name.rpartition("/")[2])


def goal_conditions(problem: ProblemFile) -> list[str]:
    """Return the goal's conditions, such as `atop(lettuce1, tomato1)`.

    Only kinds that occur several times have numbers.
    """
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
    """Return whether two goals have the same conditions apart from the objects' numbers.

    Objects are distinguished by the conditions of themselves and their neighbours (colour
    refinement). That is not exact for all graphs, but for stacks and soups.
    """
    return _shape(a) == _shape(b)


_Term = tuple[str, tuple[Any, ...]]
"""Predicate of a condition, and its ids."""


def _shape(goal: Sequence[GoalTerm]) -> Counter[Any]:
    colours: dict[Any, Any] = dict(_kinds(goal))
    terms = {(term.predicate, term.ids) for term in goal}
    own: dict[Any, list[_Term]] = {id_: [] for id_ in colours}
    for predicate, ids in terms:
        for id_ in dict.fromkeys(ids):
            own[id_].append((predicate, ids))
    known = 0
    for _ in range(MAX_ROUNDS):
        # Further rounds distinguish nothing if this one would not.
        if known == (found := len(set(colours.values()))):
            break
        known = found
        colours = {
            id_: hash((colour, _around(id_, own[id_], colours))) for id_, colour in colours.items()
        }
    return Counter((predicate, tuple(colours[i] for i in ids)) for predicate, ids in terms)


def _around(id_: Any, own: Iterable[_Term], colours: dict[Any, Any]) -> Any:
    around = Counter(
        (predicate, ids.index(id_), tuple(colours[i] for i in ids)) for predicate, ids in own
    )
    return frozenset(around.items())


SHOWN = ("station", "item", "container")
"""Types of objects that are listed by kind."""


@dataclass(frozen=True, slots=True)
class Difference:
    """Aspect in which two things differ, with both values; empty for nothing."""

    aspect: str
    a: str
    b: str


@dataclass(frozen=True, slots=True)
class TaskDifferences:
    """Differences between a task and its counterpart; None if a pack lacks it."""

    a: str | None
    b: str | None
    differences: tuple[Difference, ...] = ()


@dataclass(frozen=True, slots=True)
class PackDifferences:
    """Differences between two packs: in all, in the words of their domains, and by task."""

    a: str
    b: str
    overall: tuple[Difference, ...]
    wording: tuple[Difference, ...]
    tasks: tuple[TaskDifferences, ...]

    @property
    def none(self) -> bool:
        """True if there are no differences."""
        alone = any(task.a is None or task.b is None for task in self.tasks)
        found = any(task.differences for task in self.tasks)
        return not (self.overall or self.wording or alone or found)


def compare_packs(a: Pack, b: Pack) -> PackDifferences:
    """Return the differences between two packs."""
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
    """Return the domain's description of each predicate and action."""
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
    """Return the conditions that the other goal lacks."""
    own = Counter(goal_conditions(problem)) - Counter(goal_conditions(other))
    return ", ".join(own.elements())


def _objects(problem: ProblemFile, kind: str) -> str:
    """Return kinds with their number and, in brackets, their predicates."""
    return _counted(
        f"{thing.name} [{', '.join(sorted(thing.predicates))}]" if thing.predicates else thing.name
        for thing in problem.objects.get(kind, ())
    )


def _players(problem: ProblemFile) -> str:
    listed = len(problem.objects.get("player", ()))
    return " or ".join(map(str, problem.seats or (listed,)))


def _places(problem: ProblemFile) -> str:
    """Return the objects that do not start on a table.

    All tables are alike, so objects on them make no difference.
    """
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
    if not instances:
        return ""
    try:
        return str(pack.budget(instances[0], "published").max_steps)
    except RobotouilleError:
        return ""


NOTHING = "–"

Row = tuple[str, str, str, str]


def text_tables(found: PackDifferences) -> list[Table]:
    """Return the tables with rows for a terminal: in all, by task, by word."""
    tables = []
    for title, rows in _sections(found):
        names = (Text(printable(name)) for name in (found.a, found.b))
        table = Table("", "", title=title, title_justify="left", show_lines=False)
        for name in names:
            table.add_column(name)
        for row in rows:
            table.add_row(*(Text(printable(cell)) for cell in row))
        tables.append(table)
    return tables


def markdown_tables(found: PackDifferences) -> str:
    """Return the same tables as Markdown, each with a heading."""
    lines: list[str] = []
    for title, rows in _sections(found):
        lines += [
            f"### {title}",
            "",
            f"| | | {_cell(found.a)} | {_cell(found.b)} |",
            "| --- | --- | --- | --- |",
        ]
        lines += [f"| {' | '.join(map(_cell, row))} |" for row in rows]
        lines.append("")
    return "\n".join(lines)


def _cell(text: str) -> str:
    return printable(text).replace("|", "\\|").replace("[", "\\[").replace("]", "\\]")


def _sections(found: PackDifferences) -> Iterator[tuple[str, Sequence[Row]]]:
    sections = {
        "In all": [_row("", difference) for difference in found.overall],
        "By task": [row for task in found.tasks for row in _task_rows(task)],
        "Words of the domain": [_row("", difference) for difference in found.wording],
    }
    return ((title, rows) for title, rows in sections.items() if rows)


def _task_rows(task: TaskDifferences) -> Iterator[Row]:
    """Yield a row with a task's names and a row for each difference; nothing without any."""
    if task.differences or task.a is None or task.b is None:
        yield "task", "", task.a or NOTHING, task.b or NOTHING
    for difference in task.differences:
        yield _row("", difference)


def _row(task: str, difference: Difference) -> Row:
    return task, difference.aspect, difference.a or NOTHING, difference.b or NOTHING
